//! Interactive charts of a page: lines over an axis, and planes with paths and heat maps.
//!
//! A chart is data only. [`Page`](super::Page) embeds it as JSON, and `chart.js` draws it in the browser with
//! uPlot: values under the cursor, zoom by drag, curves that can be hidden, dark mode. Numbers are rounded to what a
//! screen can show, so pages stay small and the same data give the same bytes.

mod figure;

use super::html::escape;
pub use figure::figure;
use serde_json::{Map, Value, json};

/// Colour by role; the page has one shade for light mode and one for dark mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Colour {
    /// Text colour: measurements.
    Ink,
    /// Reference lines and context.
    Grey,
    /// First data colour.
    Blue,
    /// Second data colour.
    Orange,
    /// Third data colour.
    Green,
    /// Fourth data colour.
    Purple,
    /// Fifth data colour.
    Red,
    /// Sixth data colour.
    Teal,
    /// Seventh data colour.
    Olive,
    /// Eighth data colour.
    Pink,
    /// Ninth data colour.
    Brown,
    /// Tenth data colour; the ball.
    Gold,
}

impl Colour {
    /// Data colours in the order of use.
    pub const SERIES: [Self; 10] = [
        Self::Blue,
        Self::Orange,
        Self::Green,
        Self::Purple,
        Self::Red,
        Self::Teal,
        Self::Olive,
        Self::Pink,
        Self::Brown,
        Self::Gold,
    ];

    /// Colour of series `index`; the palette repeats.
    #[must_use]
    pub fn of_series(index: usize) -> Self {
        Self::SERIES[index % Self::SERIES.len()]
    }

    /// Name of the CSS variable.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ink => "ink",
            Self::Grey => "grey",
            Self::Blue => "blue",
            Self::Orange => "orange",
            Self::Green => "green",
            Self::Purple => "purple",
            Self::Red => "red",
            Self::Teal => "teal",
            Self::Olive => "olive",
            Self::Pink => "pink",
            Self::Brown => "brown",
            Self::Gold => "gold",
        }
    }
}

/// Scale of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Linear.
    Linear,
    /// Logarithmic; only positive values are drawn.
    Logarithmic,
}

/// Axis of a chart.
#[derive(Debug, Clone)]
pub struct Axis {
    quantity: String,
    unit: String,
    scale: Scale,
    include: Option<f64>,
    range: Option<(f64, f64)>,
    reversed: bool,
    categories: Vec<String>,
}

impl Axis {
    /// Linear axis of `quantity` in `unit`; the unit is empty for a ratio.
    #[must_use]
    pub fn new(quantity: &str, unit: &str) -> Self {
        Self {
            quantity: quantity.to_owned(),
            unit: unit.to_owned(),
            scale: Scale::Linear,
            include: None,
            range: None,
            reversed: false,
            categories: Vec::new(),
        }
    }

    /// Axis whose positions 0, 1, 2 ... have names; a line feed splits a name into lines.
    #[must_use]
    pub fn of_categories(quantity: &str, names: Vec<String>) -> Self {
        Self { categories: names, ..Self::new(quantity, "") }
    }

    /// The same axis with a logarithmic scale.
    #[must_use]
    pub fn logarithmic(self) -> Self {
        Self { scale: Scale::Logarithmic, ..self }
    }

    /// The same axis with `value` always in its range, such as zero for a rate.
    #[must_use]
    pub fn including(self, value: f64) -> Self {
        Self { include: Some(value), ..self }
    }

    /// The same axis with a fixed range, for charts that are compared.
    #[must_use]
    pub fn within(self, low: f64, high: f64) -> Self {
        Self { range: (low < high).then_some((low, high)), ..self }
    }

    /// The same axis with its values rising to the left or downwards.
    #[must_use]
    pub fn reversed(self) -> Self {
        Self { reversed: true, ..self }
    }

    fn label(&self) -> String {
        match self.unit.as_str() {
            "" => self.quantity.clone(),
            unit => format!("{} ({unit})", self.quantity),
        }
    }

    fn json(&self) -> Value {
        let mut json = Map::new();
        json.insert("name".into(), self.quantity.clone().into());
        json.insert("label".into(), self.label().into());
        if !self.unit.is_empty() {
            json.insert("unit".into(), self.unit.clone().into());
        }
        if self.scale == Scale::Logarithmic {
            json.insert("log".into(), true.into());
        }
        if self.reversed {
            json.insert("reversed".into(), true.into());
        }
        if let Some(value) = self.include {
            json.insert("include".into(), value.into());
        }
        if let Some((low, high)) = self.range {
            json.insert("range".into(), json!([low, high]));
        }
        if !self.categories.is_empty() {
            json.insert("categories".into(), json!(self.categories));
        }
        Value::Object(json)
    }
}

/// Way in which a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Mark {
    Line,
    Dashed,
    Marked,
    Dots,
    Rings,
    Crosses,
    Steps,
    Band,
    Level(f64),
}

impl Mark {
    fn name(self) -> &'static str {
        match self {
            Self::Line => "line",
            Self::Dashed | Self::Level(_) => "dashed",
            Self::Marked => "marked",
            Self::Dots => "dots",
            Self::Rings => "rings",
            Self::Crosses => "crosses",
            Self::Steps => "steps",
            Self::Band => "band",
        }
    }
}

/// Points (x, y) of a curve; a value that is not finite is a break.
pub type Points = Vec<(f64, f64)>;

/// Points (x, low, high) of a band or of error bars.
pub type Ranges = Vec<(f64, f64, f64)>;

/// Entry of a legend with its curves.
#[derive(Debug, Clone)]
pub struct Series {
    name: String,
    colour: Colour,
    mark: Mark,
    width: Option<f64>,
    curves: Vec<Points>,
    ranges: Ranges,
    whiskers: bool,
    quiet: bool,
}

impl Series {
    fn new(name: &str, colour: Colour, mark: Mark, curves: Vec<Points>) -> Self {
        Self {
            name: name.to_owned(),
            colour,
            mark,
            width: None,
            curves,
            ranges: Vec::new(),
            whiskers: false,
            quiet: false,
        }
    }

    /// Solid line through `points`, whose x ascend except in a plane.
    #[must_use]
    pub fn line(name: &str, colour: Colour, points: Points) -> Self {
        Self::new(name, colour, Mark::Line, vec![points])
    }

    /// Several lines under one name, such as one for each seed.
    #[must_use]
    pub fn lines(name: &str, colour: Colour, curves: Vec<Points>) -> Self {
        Self::new(name, colour, Mark::Line, curves)
    }

    /// Dashed line.
    #[must_use]
    pub fn dashed(name: &str, colour: Colour, points: Points) -> Self {
        Self::new(name, colour, Mark::Dashed, vec![points])
    }

    /// Line with a dot at each point.
    #[must_use]
    pub fn marked(name: &str, colour: Colour, points: Points) -> Self {
        Self::new(name, colour, Mark::Marked, vec![points])
    }

    /// Dots.
    #[must_use]
    pub fn dots(name: &str, colour: Colour, points: Points) -> Self {
        Self::new(name, colour, Mark::Dots, vec![points])
    }

    /// Rings.
    #[must_use]
    pub fn rings(name: &str, colour: Colour, points: Points) -> Self {
        Self::new(name, colour, Mark::Rings, vec![points])
    }

    /// Crosses.
    #[must_use]
    pub fn crosses(name: &str, colour: Colour, points: Points) -> Self {
        Self::new(name, colour, Mark::Crosses, vec![points])
    }

    /// Steps: each value holds until the next x.
    #[must_use]
    pub fn steps(name: &str, colour: Colour, points: Points) -> Self {
        Self::new(name, colour, Mark::Steps, vec![points])
    }

    /// Band without a curve.
    #[must_use]
    pub fn band(name: &str, colour: Colour, ranges: Ranges) -> Self {
        Self { ranges, ..Self::new(name, colour, Mark::Band, Vec::new()) }
    }

    /// Horizontal line across the whole chart.
    #[must_use]
    pub fn level(name: &str, colour: Colour, value: f64) -> Self {
        Self::new(name, colour, Mark::Level(value), Vec::new())
    }

    /// The same series with a shaded band around its first curve.
    #[must_use]
    pub fn with_band(self, ranges: Ranges) -> Self {
        Self { ranges, ..self }
    }

    /// The same series with error bars.
    #[must_use]
    pub fn with_whiskers(self, ranges: Ranges) -> Self {
        Self { ranges, whiskers: true, ..self }
    }

    /// The same series with lines of `width` px; the usual width is 1.8 px.
    #[must_use]
    pub fn with_width(self, width: f64) -> Self {
        Self { width: Some(width), ..self }
    }

    /// The same series without values under the cursor, such as the outline of a board.
    #[must_use]
    pub fn quiet(self) -> Self {
        Self { quiet: true, ..self }
    }

    fn json(&self, kind: Kind, digits: [Digits; 2]) -> Value {
        let mut json = Map::new();
        json.insert("name".into(), self.name.clone().into());
        json.insert("colour".into(), self.colour.name().into());
        json.insert("mark".into(), self.mark.name().into());
        if let Some(width) = self.width {
            json.insert("width".into(), width.into());
        }
        if self.whiskers {
            json.insert("whiskers".into(), true.into());
        }
        if self.quiet {
            json.insert("quiet".into(), true.into());
        }
        let curves = match self.mark {
            Mark::Level(value) => {
                json.insert("level".into(), number(value, Digits::Significant(9)));
                Vec::new()
            }
            Mark::Band => vec![self.curve_json(None, digits)],
            _ => {
                let thin = |points: &Points| match kind {
                    Kind::Lines => thinned(points),
                    Kind::Plane => points.clone(),
                };
                let curves = self.curves.iter().map(thin).enumerate();
                let first = |index| if index == 0 { &self.ranges[..] } else { &[] };
                curves.flat_map(|(k, points)| curve_json(&points, first(k), digits)).collect()
            }
        };
        json.insert("curves".into(), Value::Array(curves));
        Value::Object(json)
    }

    /// Band without a curve as JSON.
    fn curve_json(&self, y: Option<Value>, digits: [Digits; 2]) -> Value {
        let mut json = Map::new();
        let xs: Vec<f64> = self.ranges.iter().map(|range| range.0).collect();
        json.insert("x".into(), positions(&xs, digits[0]));
        if let Some(y) = y {
            json.insert("y".into(), y);
        }
        insert_ranges(&mut json, &self.ranges, digits[1]);
        Value::Object(json)
    }
}

/// JSON of one curve with its ranges: two curves where their x differ.
fn curve_json(points: &Points, ranges: &[(f64, f64, f64)], digits: [Digits; 2]) -> Vec<Value> {
    let mut json = Map::new();
    let xs: Vec<f64> = points.iter().map(|point| point.0).collect();
    let ys: Vec<f64> = points.iter().map(|point| point.1).collect();
    json.insert("x".into(), positions(&xs, digits[0]));
    json.insert("y".into(), numbers(&ys, digits[1]));
    if ranges.is_empty() {
        return vec![Value::Object(json)];
    }
    let same = |(point, range): (&(f64, f64), &(f64, f64, f64))| {
        (point.0 - range.0).abs() <= 1e-9 * (1.0 + range.0.abs())
    };
    if points.len() == ranges.len() && points.iter().zip(ranges).all(same) {
        insert_ranges(&mut json, ranges, digits[1]);
        return vec![Value::Object(json)];
    }
    let mut own = Map::new();
    let xs: Vec<f64> = ranges.iter().map(|range| range.0).collect();
    own.insert("x".into(), positions(&xs, digits[0]));
    insert_ranges(&mut own, ranges, digits[1]);
    vec![Value::Object(json), Value::Object(own)]
}

fn insert_ranges(json: &mut Map<String, Value>, ranges: &[(f64, f64, f64)], digits: Digits) {
    let lows: Vec<f64> = ranges.iter().map(|range| range.1).collect();
    let highs: Vec<f64> = ranges.iter().map(|range| range.2).collect();
    json.insert("low".into(), numbers(&lows, digits));
    json.insert("high".into(), numbers(&highs, digits));
}

/// Cells of a plane, drawn as colours.
#[derive(Debug, Clone)]
pub struct Grid {
    values: Vec<Vec<f64>>,
    x: (f64, f64),
    y: (f64, f64),
    shades: Shades,
    text: Vec<Vec<String>>,
}

#[derive(Debug, Clone)]
enum Shades {
    Numbers { label: String, range: Option<(f64, f64)>, logarithmic: bool },
    Classes(Vec<(String, Colour)>),
}

impl Grid {
    /// Numbers `[row][column]` from the lowest row up, over the edges `x` and `y`; NaN is left blank. `label` names
    /// the quantity and its unit.
    #[must_use]
    pub fn of_numbers(
        values: Vec<Vec<f64>>,
        x: (f64, f64),
        y: (f64, f64),
        label: impl Into<String>,
    ) -> Self {
        let shades = Shades::Numbers { label: label.into(), range: None, logarithmic: false };
        Self { values, x, y, shades, text: Vec::new() }
    }

    /// Indices into `classes` instead of numbers, each class with its own colour.
    #[must_use]
    pub fn of_classes(
        values: Vec<Vec<f64>>,
        x: (f64, f64),
        y: (f64, f64),
        classes: Vec<(String, Colour)>,
    ) -> Self {
        Self { values, x, y, shades: Shades::Classes(classes), text: Vec::new() }
    }

    /// The same grid with fixed ends of its colour scale, for grids that are compared; larger values have the last
    /// colour.
    #[must_use]
    pub fn within(mut self, low: f64, high: f64) -> Self {
        if let Shades::Numbers { range, .. } = &mut self.shades {
            *range = Some((low, high));
        }
        self
    }

    /// The same grid with logarithmic colours; its values are decadic logarithms.
    #[must_use]
    pub fn of_logarithms(mut self) -> Self {
        if let Shades::Numbers { logarithmic, .. } = &mut self.shades {
            *logarithmic = true;
        }
        self
    }

    /// The same grid with `text[row][column]` in cells that are large enough.
    #[must_use]
    pub fn with_text(self, text: Vec<Vec<String>>) -> Self {
        Self { text, ..self }
    }

    fn finite(&self) -> impl Iterator<Item = f64> {
        self.values.iter().flatten().copied().filter(|value| value.is_finite())
    }

    fn json(&self) -> Value {
        let mut json = Map::new();
        let rows = self.values.iter().map(|row| numbers(row, Digits::Significant(4)));
        json.insert("values".into(), rows.collect());
        json.insert("x".into(), json!([self.x.0, self.x.1]));
        json.insert("y".into(), json!([self.y.0, self.y.1]));
        match &self.shades {
            Shades::Classes(classes) => {
                let classes = classes.iter().map(|(name, colour)| json!([name, colour.name()]));
                json.insert("classes".into(), classes.collect());
            }
            Shades::Numbers { label, range, logarithmic } => {
                let largest = self.finite().fold(f64::NEG_INFINITY, f64::max);
                let own = (self.finite().fold(f64::INFINITY, f64::min), largest);
                let (low, high) = range.unwrap_or(own);
                json.insert("label".into(), label.clone().into());
                json.insert("low".into(), number(low, Digits::Significant(6)));
                json.insert("high".into(), number(high, Digits::Significant(6)));
                if high < largest {
                    json.insert("clipped".into(), true.into());
                }
                if *logarithmic {
                    json.insert("log".into(), true.into());
                }
            }
        }
        if !self.text.is_empty() {
            json.insert("text".into(), json!(self.text));
        }
        Value::Object(json)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Lines,
    Plane,
}

/// Chart.
#[derive(Debug, Clone)]
pub struct Chart {
    title: String,
    kind: Kind,
    equal: bool,
    x: Axis,
    y: Axis,
    height: u32,
    group: Option<String>,
    series: Vec<Series>,
    grid: Option<Grid>,
}

impl Chart {
    fn new(title: &str, kind: Kind, x: Axis, y: Axis) -> Self {
        Self {
            title: title.to_owned(),
            kind,
            equal: false,
            x,
            y,
            height: 300,
            group: None,
            series: Vec::new(),
            grid: None,
        }
    }

    /// Curves over a common axis `x`.
    #[must_use]
    pub fn of_lines(title: &str, x: Axis, y: Axis) -> Self {
        Self::new(title, Kind::Lines, x, y)
    }

    /// Paths, dots and cells in a plane.
    #[must_use]
    pub fn of_plane(title: &str, x: Axis, y: Axis) -> Self {
        Self { height: 400, ..Self::new(title, Kind::Plane, x, y) }
    }

    /// The same chart with another title.
    #[must_use]
    pub fn titled(self, title: &str) -> Self {
        Self { title: title.to_owned(), ..self }
    }

    /// The same chart with one scale for both axes, so that a circle is round.
    #[must_use]
    pub fn with_equal_axes(self) -> Self {
        Self { equal: true, ..self }
    }

    /// The same chart with `series` on top.
    #[must_use]
    pub fn with(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// The same chart with all of `series` on top.
    #[must_use]
    pub fn with_all(mut self, series: impl IntoIterator<Item = Series>) -> Self {
        self.series.extend(series);
        self
    }

    /// The same chart over coloured cells.
    #[must_use]
    pub fn with_grid(self, grid: Grid) -> Self {
        Self { grid: Some(grid), ..self }
    }

    /// The same chart `height` px high; with equal axes the largest height of the data.
    #[must_use]
    pub fn with_height(self, height: u32) -> Self {
        Self { height, ..self }
    }

    /// The same chart with cursor and zoom along x shared by all charts of `group`.
    #[must_use]
    pub fn in_group(self, group: &str) -> Self {
        Self { group: Some(group.to_owned()), ..self }
    }

    /// Smallest and largest finite y of all series; `None` without any.
    #[must_use]
    pub fn y_range(&self) -> Option<(f64, f64)> {
        let curves = self.series.iter().flat_map(|series| &series.curves).flatten();
        let ranges = self.series.iter().flat_map(|series| &series.ranges);
        let all = curves.map(|point| point.1).chain(ranges.flat_map(|range| [range.1, range.2]));
        extremes(all)
    }

    fn digits(&self) -> [Digits; 2] {
        let curves = || self.series.iter().flat_map(|series| &series.curves).flatten();
        let ranges = || self.series.iter().flat_map(|series| &series.ranges);
        let x = curves().map(|point| point.0).chain(ranges().map(|range| range.0));
        [Digits::of(&self.x, extremes(x)), Digits::of(&self.y, self.y_range())]
    }

    /// Markup of the chart with its data.
    pub(super) fn html(&self) -> String {
        let digits = self.digits();
        let mut json = Map::new();
        let kind = if self.kind == Kind::Plane { "plane" } else { "lines" };
        json.insert("kind".into(), kind.into());
        json.insert("x".into(), self.x.json());
        json.insert("y".into(), self.y.json());
        json.insert("height".into(), self.height.into());
        if self.equal {
            json.insert("equal".into(), true.into());
        }
        if let Some(group) = &self.group {
            json.insert("group".into(), group.clone().into());
        }
        let series = self.series.iter().map(|series| series.json(self.kind, digits));
        json.insert("series".into(), series.collect());
        if let Some(grid) = &self.grid {
            json.insert("grid".into(), grid.json());
        }
        // No character of the data can end the script or begin a comment.
        let json = Value::Object(json).to_string().replace('<', "\\u003c");
        let title = escape(&self.title);
        let caption = match title.as_str() {
            "" => String::new(),
            title => format!("<figcaption>{title}</figcaption>"),
        };
        format!(
            "<figure class=\"chart\">{caption}<div class=\"legend\"></div><div class=\"plot\"></div>\
             <div class=\"readout\"></div><script type=\"application/json\">{json}</script></figure>\n"
        )
    }
}

/// Give charts that are compared the same y axis.
#[must_use]
pub fn with_same_y(charts: Vec<Chart>) -> Vec<Chart> {
    let ends = charts.iter().filter_map(Chart::y_range).flat_map(|(low, high)| [low, high]);
    let include = charts.iter().filter_map(|chart| chart.y.include);
    let Some((low, high)) = extremes(ends.chain(include)) else { return charts };
    let room = if low < high { 0.06 * (high - low) } else { 0.5 };
    let floor =
        if charts.iter().any(|chart| chart.y.include == Some(low)) { low } else { low - room };
    let shared = |chart: Chart| Chart { y: chart.y.within(floor, high + room), ..chart };
    charts.into_iter().map(shared).collect()
}

/// Smallest and largest of the finite values.
fn extremes(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.filter(|value| value.is_finite()).fold(None, |found, value| match found {
        None => Some((value, value)),
        Some((low, high)) => Some((f64::min(low, value), f64::max(high, value))),
    })
}

/// Precision of written numbers.
#[derive(Debug, Clone, Copy)]
enum Digits {
    /// Digits behind the point.
    Decimals(i32),
    /// Significant digits.
    Significant(usize),
}

impl Digits {
    /// Steps that the range of an axis is divided into: more than a screen has pixels, so that a zoom stays smooth.
    const STEPS: f64 = 4e4;

    fn of(axis: &Axis, range: Option<(f64, f64)>) -> Self {
        match range {
            Some((low, high)) if axis.scale == Scale::Linear && low < high => {
                let decimals = (Self::STEPS / (high - low)).log10().ceil() as i32;
                if (0..=9).contains(&decimals) {
                    Self::Decimals(decimals)
                } else {
                    Self::Significant(if decimals < 0 { 9 } else { 6 })
                }
            }
            _ => Self::Significant(6),
        }
    }
}

/// `value` rounded; null where it is not finite.
fn number(value: f64, digits: Digits) -> Value {
    if !value.is_finite() {
        return Value::Null;
    }
    let rounded = match digits {
        Digits::Decimals(decimals) => {
            let scale = 10_f64.powi(decimals);
            (value * scale).round() / scale
        }
        Digits::Significant(count) => {
            format!("{value:.*e}", count.saturating_sub(1)).parse().unwrap_or(value)
        }
    };
    if rounded == rounded.trunc() && rounded.abs() < 1e15 {
        Value::from(rounded as i64)
    } else {
        Value::from(rounded)
    }
}

fn numbers(values: &[f64], digits: Digits) -> Value {
    values.iter().map(|value| number(*value, digits)).collect()
}

/// Fewest positions that are written as start, distance and count.
const LEAST_EVEN: usize = 4;

/// Positions along x: start, distance and count where they are even, else each of them.
fn positions(values: &[f64], digits: Digits) -> Value {
    let count = values.len();
    if LEAST_EVEN <= count && values.iter().all(|value| value.is_finite()) {
        let (first, last) = (values[0], values[count - 1]);
        let step = (last - first) / (count - 1) as f64;
        let even = |(k, value): (usize, &f64)| {
            (value - (first + k as f64 * step)).abs() <= 1e-3 * step.abs()
        };
        if step != 0.0 && values.iter().enumerate().all(even) {
            let [first, step] = [first, step].map(|value| number(value, Digits::Significant(9)));
            return json!({ "s": first, "d": step, "n": count });
        }
    }
    numbers(values, digits)
}

/// Most points of a curve; a longer one is reduced to the extremes of each part.
const MOST_POINTS: usize = 6000;

/// `points`, or the smallest and the largest of each of many parts where there are more than a screen shows.
fn thinned(points: &Points) -> Points {
    if points.len() <= MOST_POINTS {
        return points.clone();
    }
    let part = points.len().div_ceil(MOST_POINTS / 2);
    let ends = |part: &[(f64, f64)]| {
        let finite = || (0..part.len()).filter(|index| part[*index].1.is_finite());
        let low = finite().min_by(|a, b| part[*a].1.total_cmp(&part[*b].1));
        let high = finite().max_by(|a, b| part[*a].1.total_cmp(&part[*b].1));
        match (low, high) {
            (Some(low), Some(high)) if low != high => {
                vec![part[low.min(high)], part[low.max(high)]]
            }
            (Some(only), _) => vec![part[only]],
            _ => part.first().copied().into_iter().collect(),
        }
    };
    points.chunks(part).flat_map(ends).collect()
}

#[cfg(test)]
mod tests;
