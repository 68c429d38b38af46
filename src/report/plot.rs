//! Line plots with bands, paths at one scale for both axes, and heat maps, as SVG.

use plotters::{
    coord::{
        Shift,
        ranged1d::{Ranged, ValueFormatter},
        types::RangedCoordf64,
    },
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

/// How an axis runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By powers of ten; only positive values are drawn.
    Logarithmic,
}

/// One axis of a line plot.
#[derive(Debug, Clone)]
pub struct Axis {
    /// Label with unit.
    pub label: String,
    /// How it runs.
    pub scale: Scale,
}

/// How a curve is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stroke {
    /// A full line.
    Solid,
    /// A dashed line.
    Dashed,
}

/// A curve; the page names its colour in a legend.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// How it is drawn.
    pub stroke: Stroke,
    /// x and y.
    pub points: Vec<(f64, f64)>,
}

/// A shaded band between two curves.
#[derive(Debug, Clone)]
pub struct Band {
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// x, low and high.
    pub points: Vec<(f64, f64, f64)>,
}

/// A plot of curves over bands.
#[derive(Debug, Clone)]
pub struct LinePlot {
    /// Heading.
    pub title: String,
    /// Horizontal axis; always linear.
    pub x: String,
    /// Vertical axis.
    pub y: Axis,
    /// Drawn first.
    pub bands: Vec<Band>,
    /// Drawn over the bands.
    pub curves: Vec<Curve>,
    /// Width and height (px).
    pub size: (u32, u32),
}

/// A grid of values, drawn as colours.
#[derive(Debug, Clone)]
pub struct HeatMap {
    /// Heading.
    pub title: String,
    /// Label of the columns, with unit.
    pub x: String,
    /// Label of the rows, with unit.
    pub y: String,
    /// First and last edge of the columns.
    pub x_range: (f64, f64),
    /// First and last edge of the rows.
    pub y_range: (f64, f64),
    /// `[row][column]`, from the lowest; NaN is left blank.
    pub values: Vec<Vec<f64>>,
    /// What is written into each cell, which then stands for the ticks; empty for numeric axes.
    pub cells: Vec<Vec<String>>,
    /// Width and height (px).
    pub size: (u32, u32),
}

/// Curves over named steps, on a logarithmic axis.
#[derive(Debug, Clone)]
pub struct StepPlot {
    /// Heading.
    pub title: String,
    /// Label of the vertical axis, with unit.
    pub y: String,
    /// Name of each step, in lines.
    pub steps: Vec<Vec<String>>,
    /// A level that is drawn dashed across.
    pub level: f64,
    /// Curves whose x is the index of a step; only positive values are drawn.
    pub curves: Vec<Curve>,
    /// Width and height (px).
    pub size: (u32, u32),
}

const FONT: &str = "sans-serif";
const GRID: RGBColor = RGBColor(228, 232, 238);
/// Dashes and gaps (px).
const DASH: (i32, i32) = (6, 4);

type Drawn = Result<(), Box<dyn std::error::Error>>;

/// Draws a line plot.
#[must_use]
pub fn line_plot(plot: &LinePlot) -> String {
    let mut svg = String::new();
    let drawn = draw_line_plot(plot, &mut svg);
    or_note(svg, drawn)
}

/// Draws a line plot of places: one unit is as long across as it is up, so that a circle is round.
/// Both axes are linear.
#[must_use]
pub fn path_plot(plot: &LinePlot) -> String {
    let mut svg = String::new();
    let drawn = draw_path_plot(plot, &mut svg);
    or_note(svg, drawn)
}

/// Draws a heat map.
#[must_use]
pub fn heat_map(map: &HeatMap) -> String {
    let values = map.values.iter().flatten().copied().filter(|value| value.is_finite());
    heat_map_within(map, range(values))
}

/// Draws a heat map whose palest and darkest colours stand for the two values of `shades`, so that
/// several maps can be compared.
#[must_use]
pub fn heat_map_within(map: &HeatMap, shades: (f64, f64)) -> String {
    let mut svg = String::new();
    let drawn = draw_heat_map(map, shades, &mut svg);
    or_note(svg, drawn)
}

/// Draws curves over named steps.
#[must_use]
pub fn step_plot(plot: &StepPlot) -> String {
    let mut svg = String::new();
    let drawn = draw_step_plot(plot, &mut svg);
    or_note(svg, drawn)
}

/// A report with one picture missing is better than none; it says which and why.
fn or_note(svg: String, drawn: Drawn) -> String {
    match drawn {
        Ok(()) => svg,
        Err(error) => format!("<p>picture not drawn: {}</p>", super::escape(&error.to_string())),
    }
}

fn finite(plot: &LinePlot) -> impl Iterator<Item = (f64, f64)> {
    let bands = plot.bands.iter().flat_map(|band| &band.points);
    let ends = bands.flat_map(|(x, low, high)| [(*x, *low), (*x, *high)]);
    let positive = plot.y.scale == Scale::Logarithmic;
    plot.curves
        .iter()
        .flat_map(|curve| curve.points.iter().copied())
        .chain(ends)
        .filter(move |(x, y)| x.is_finite() && y.is_finite() && (!positive || 0.0 < *y))
}

/// Smallest and largest of some values, never the same.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    if high < low {
        (0.0, 1.0)
    } else if low < high {
        (low, high)
    } else {
        (low - 0.5, high + 0.5)
    }
}

/// Room for title and labels, the same for all line plots.
fn frame(plot: &LinePlot, builder: &mut ChartBuilder<'_, '_, SVGBackend<'_>>) {
    builder
        .caption(&plot.title, (FONT, 17))
        .margin(10)
        .margin_right(24)
        .x_label_area_size(42)
        .y_label_area_size(68);
}

fn draw_path_plot(plot: &LinePlot, svg: &mut String) -> Drawn {
    let (left, right) = range(finite(plot).map(|(x, _)| x));
    let (low, high) = range(finite(plot).map(|(_, y)| y));
    let (across, up) = (1.06 * (right - left), 1.06 * (high - low));
    let (wide, tall) = plotting_size(plot)?;
    // Units per pixel: the axis that needs more of them decides.
    let scale = (across / wide).max(up / tall);
    let about = |from: f64, to: f64, pixels: f64| {
        let middle = f64::midpoint(from, to);
        middle - scale * pixels / 2.0..middle + scale * pixels / 2.0
    };
    let area = SVGBackend::with_string(svg, plot.size).into_drawing_area();
    area.fill(&WHITE)?;
    let mut builder = ChartBuilder::on(&area);
    frame(plot, &mut builder);
    let heights = about(low, high, tall);
    let floor = heights.start;
    let chart = builder.build_cartesian_2d(about(left, right, wide), heights)?;
    draw_curves(plot, chart, floor)?;
    area.present()?;
    Ok(())
}

/// Width and height (px) of what is left for the curves.
fn plotting_size(plot: &LinePlot) -> Result<(f64, f64), Box<dyn std::error::Error>> {
    let mut unused = String::new();
    let area = SVGBackend::with_string(&mut unused, plot.size).into_drawing_area();
    let mut builder = ChartBuilder::on(&area);
    frame(plot, &mut builder);
    let chart = builder.build_cartesian_2d(0.0..1.0, 0.0..1.0)?;
    let (wide, tall) = chart.plotting_area().dim_in_pixel();
    Ok((f64::from(wide.max(1)), f64::from(tall.max(1))))
}

fn draw_line_plot(plot: &LinePlot, svg: &mut String) -> Drawn {
    let area = SVGBackend::with_string(svg, plot.size).into_drawing_area();
    area.fill(&WHITE)?;
    let (left, right) = range(finite(plot).map(|(x, _)| x));
    let (low, high) = range(finite(plot).map(|(_, y)| y));
    let mut builder = ChartBuilder::on(&area);
    frame(plot, &mut builder);
    match plot.y.scale {
        Scale::Linear => {
            let room = 0.06 * (high - low);
            let chart = builder.build_cartesian_2d(left..right, low - room..high + room)?;
            draw_curves(plot, chart, low - room)?;
        }
        Scale::Logarithmic => {
            let (low, high) = (low.max(f64::MIN_POSITIVE), high.max(f64::MIN_POSITIVE));
            let (low, high, ticks) = decades(low / 1.3, high * 1.3);
            let span = (low..high).log_scale().with_key_points(ticks);
            let chart = builder.build_cartesian_2d(left..right, span)?;
            draw_curves(plot, chart, low)?;
        }
    }
    area.present()?;
    Ok(())
}

fn draw_curves<'a, Y>(
    plot: &LinePlot,
    mut chart: ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, Y>>,
    floor: f64,
) -> Drawn
where
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    chart
        .configure_mesh()
        .x_desc(&plot.x)
        .y_desc(&plot.y.label)
        .axis_desc_style((FONT, 14))
        .label_style((FONT, 13))
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID)
        .x_labels(9)
        .y_labels(7)
        .y_label_formatter(&|value| short(*value))
        .x_label_formatter(&|value| short(*value))
        .draw()?;
    for band in &plot.bands {
        let outline: Vec<(f64, f64)> = band
            .points
            .iter()
            .map(|(x, _, high)| (*x, high.max(floor)))
            .chain(band.points.iter().rev().map(|(x, low, _)| (*x, low.max(floor))))
            .collect();
        chart.draw_series([Polygon::new(outline, colour(band.colour).mix(0.25))])?;
    }
    for curve in &plot.curves {
        let style = colour(curve.colour).stroke_width(2);
        let points = curve.points.iter().filter(|(_, y)| y.is_finite() && floor <= *y).copied();
        match curve.stroke {
            Stroke::Solid => {
                chart.draw_series(LineSeries::new(points, style))?;
            }
            Stroke::Dashed => {
                chart.draw_series(DashedLineSeries::new(points, DASH.0, DASH.1, style))?;
            }
        }
    }
    Ok(())
}

/// Decades beyond which only powers of ten are marked.
const WIDE_SPAN: f64 = 2.0;

/// Marks of a logarithmic axis from `low` to `high`, and the ends of the axis, which are widened to
/// hold two marks where they would hold fewer: powers of ten on a wide axis; one, two and five
/// times those on a narrow one.
fn decades(low: f64, high: f64) -> (f64, f64, Vec<f64>) {
    let wide = WIDE_SPAN < (high / low).log10();
    let steps: &[f64] = if wide { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let (first, last) = (low.log10().floor() as i32 - 1, high.log10().ceil() as i32 + 1);
    let all: Vec<f64> =
        (first..=last).flat_map(|k| steps.iter().map(move |step| step * 10_f64.powi(k))).collect();
    let within = |low: f64, high: f64| {
        let (low, high) = (low * (1.0 - 1e-9), high * (1.0 + 1e-9));
        all.iter().copied().filter(|tick| (low..=high).contains(tick)).collect::<Vec<f64>>()
    };
    let ticks = within(low, high);
    if 2 <= ticks.len() {
        return (low, high, ticks);
    }
    let below = all.iter().copied().filter(|tick| *tick <= low).fold(0.0, f64::max);
    let above = all.iter().copied().filter(|tick| high <= *tick).fold(f64::MAX, f64::min);
    if 0.0 < below && above < f64::MAX {
        (below, above, within(below, above))
    } else {
        (low, high, ticks)
    }
}

/// Ticks closer to zero than this are zero, off by rounding.
const SMALLEST_TICK: f64 = 1e-12;

/// A number with as many digits as it needs, for tick labels.
fn short(value: f64) -> String {
    if value.abs() < SMALLEST_TICK {
        "0".to_owned()
    } else if (1e-3..1e5).contains(&value.abs()) {
        let text = format!("{value:.4}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        format!("{value:.0e}")
    }
}

fn colour([red, green, blue]: [u8; 3]) -> RGBColor {
    RGBColor(red, green, blue)
}

/// Few, some, many: from pale to dark blue.
fn shade(share: f64) -> RGBColor {
    let mix = |from: f64, to: f64| (from + (to - from) * share).round() as u8;
    RGBColor(mix(226.0, 16.0), mix(236.0, 66.0), mix(247.0, 120.0))
}

const KEY_WIDTH: u32 = 92;

/// Height of one line of a step's name (px).
const STEP_LINE: u32 = 15;

fn draw_step_plot(plot: &StepPlot, svg: &mut String) -> Drawn {
    let area = SVGBackend::with_string(svg, plot.size).into_drawing_area();
    area.fill(&WHITE)?;
    let all = plot.curves.iter().flat_map(|curve| &curve.points).map(|point| point.1);
    let (low, high) = range(
        all.chain([plot.level]).filter(|value| value.is_finite() && f64::MIN_POSITIVE < *value),
    );
    let (low, high) = (low.max(f64::MIN_POSITIVE), high.max(f64::MIN_POSITIVE));
    let (low, high, ticks) = decades(low / 1.3, high * 1.3);
    let lines = plot.steps.iter().map(Vec::len).max().unwrap_or(0) as u32;
    let (left, right) = (-0.5, plot.steps.len() as f64 - 0.5);
    let mut chart = ChartBuilder::on(&area)
        .caption(&plot.title, (FONT, 17))
        .margin(10)
        .margin_right(24)
        .x_label_area_size(STEP_LINE * lines + 12)
        .y_label_area_size(68)
        .build_cartesian_2d(left..right.max(0.5), (low..high).log_scale().with_key_points(ticks))?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(0)
        .y_desc(&plot.y)
        .axis_desc_style((FONT, 14))
        .label_style((FONT, 13))
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID)
        .y_labels(7)
        .y_label_formatter(&|value| short(*value))
        .draw()?;
    let across = [(left, plot.level), (right, plot.level)];
    let grey = colour([120, 128, 138]).stroke_width(2);
    chart.draw_series(DashedLineSeries::new(across, DASH.0, DASH.1, grey))?;
    for curve in &plot.curves {
        let ink = colour(curve.colour);
        let points = || curve.points.iter().copied().filter(|(_, y)| y.is_finite() && 0.0 < *y);
        chart.draw_series(LineSeries::new(points(), ink.stroke_width(2)))?;
        chart.draw_series(points().map(|point| Circle::new(point, 4, ink.filled())))?;
    }
    let centred = || (FONT, 12).into_font().color(&BLACK).pos(Pos::new(HPos::Center, VPos::Top));
    for (index, name) in plot.steps.iter().enumerate() {
        let (x, y) = chart.backend_coord(&(index as f64, low));
        for (line, text) in name.iter().enumerate() {
            let below = y + 8 + (STEP_LINE * line as u32) as i32;
            area.draw(&Text::new(text.clone(), (x, below), centred()))?;
        }
    }
    area.present()?;
    Ok(())
}

fn draw_heat_map(map: &HeatMap, (low, high): (f64, f64), svg: &mut String) -> Drawn {
    let area = SVGBackend::with_string(svg, map.size).into_drawing_area();
    area.fill(&WHITE)?;
    let (plot, key) = area.split_horizontally(map.size.0.saturating_sub(KEY_WIDTH));
    let mut chart = ChartBuilder::on(&plot)
        .caption(&map.title, (FONT, 17))
        .margin(10)
        .x_label_area_size(42)
        .y_label_area_size(62)
        .build_cartesian_2d(map.x_range.0..map.x_range.1, map.y_range.0..map.y_range.1)?;
    let ticks = if map.cells.is_empty() { 9 } else { 0 };
    chart
        .configure_mesh()
        .disable_mesh()
        .x_labels(ticks)
        .y_labels(ticks)
        .x_desc(&map.x)
        .y_desc(&map.y)
        .axis_desc_style((FONT, 14))
        .label_style((FONT, 13))
        .x_label_formatter(&|value| short(*value))
        .y_label_formatter(&|value| short(*value))
        .draw()?;
    let edge = |range: (f64, f64), index: usize, count: usize| {
        range.0 + (range.1 - range.0) * index as f64 / count as f64
    };
    for (row, values) in map.values.iter().enumerate() {
        let rows = map.values.len();
        for (column, value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
            let corners = [(column, row), (column + 1, row + 1)]
                .map(|(x, y)| (edge(map.x_range, x, values.len()), edge(map.y_range, y, rows)));
            let share = ((value - low) / (high - low)).clamp(0.0, 1.0);
            chart.draw_series([Rectangle::new(corners, shade(share).filled())])?;
            if let Some(text) = map.cells.get(row).and_then(|cells| cells.get(column)) {
                let ink = if share < 0.5 { &BLACK } else { &WHITE };
                let style =
                    (FONT, 13).into_font().color(ink).pos(Pos::new(HPos::Center, VPos::Center));
                let middle =
                    (0.5 * (corners[0].0 + corners[1].0), 0.5 * (corners[0].1 + corners[1].1));
                chart.draw_series([Text::new(text.clone(), middle, style)])?;
            }
        }
    }
    draw_key(&key, low, high)?;
    area.present()?;
    Ok(())
}

fn draw_key(area: &DrawingArea<SVGBackend<'_>, Shift>, low: f64, high: f64) -> Drawn {
    const STEPS: i32 = 24;
    let (top, bottom) = (40, area.dim_in_pixel().1 as i32 - 56);
    for step in 0..STEPS {
        let y = |step: i32| bottom - (bottom - top) * step / STEPS;
        let fill = shade(f64::from(step) / f64::from(STEPS - 1)).filled();
        area.draw(&Rectangle::new([(4, y(step + 1)), (20, y(step))], fill))?;
    }
    for (value, y) in [(high, top - 6), (low, bottom - 6)] {
        area.draw(&Text::new(short(value), (26, y), (FONT, 13)))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
