//! Charts as a vector figure (SVG) for papers and slides, drawn by plotters.

use super::{Chart, Colour, Mark, Scale, Series};
use plotters::{
    coord::{
        ranged1d::{Ranged, ValueFormatter},
        types::RangedCoordf64,
    },
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

/// Width of a figure (px).
const WIDTH: u32 = 900;
/// Height of one line of text below a chart (px).
const LINE: u32 = 16;
const FONT: &str = "sans-serif";
const GRID: RGBColor = RGBColor(228, 232, 238);
/// Dashes and gaps (px).
const DASH: (i32, i32) = (6, 4);
/// Factor or fraction of the range that stays free above and below the curves.
const ROOM: f64 = 0.06;

type Drawn = Result<(), Box<dyn std::error::Error>>;

/// Draw line charts one below the other as an SVG document.
///
/// Lines, marked lines, dots, dashed lines and levels are drawn, over numbers or categories, on a linear or logarithmic
/// y axis; bands and whiskers are left out.
///
/// # Errors
/// A sentence that says why a chart cannot be drawn.
pub fn figure(charts: &[Chart]) -> Result<String, String> {
    let mut svg = String::new();
    let height = charts.iter().map(panel_height).sum::<u32>().max(1);
    let drawn = (|| -> Drawn {
        let mut rest = SVGBackend::with_string(&mut svg, (WIDTH, height)).into_drawing_area();
        rest.fill(&WHITE)?;
        for chart in charts {
            let (panel, below) = rest.split_vertically(panel_height(chart));
            draw(chart, &panel)?;
            rest = below;
        }
        rest.present()?;
        Ok(())
    })();
    drawn.map_err(|error| error.to_string())?;
    Ok(svg)
}

/// Height of a chart with its legend and the names below it (px).
fn panel_height(chart: &Chart) -> u32 {
    chart.height + LINE * (name_lines(chart) + chart.series.len() as u32)
}

fn name_lines(chart: &Chart) -> u32 {
    chart.x.categories.iter().map(|name| name.lines().count()).max().unwrap_or(1) as u32
}

fn draw<'a>(chart: &Chart, panel: &DrawingArea<SVGBackend<'a>, plotters::coord::Shift>) -> Drawn {
    let names = chart.x.categories.len();
    let (left, right) = if names == 0 {
        ends(points(chart).map(|point| point.0))
    } else {
        (-0.5, names as f64 - 0.5)
    };
    let is_logarithmic = chart.y.scale == Scale::Logarithmic;
    let levels = chart.series.iter().filter_map(level).chain(chart.y.include);
    let values = points(chart).map(|point| point.1).chain(levels);
    let (low, high) = ends(values.filter(|value| !is_logarithmic || 0.0 < *value));
    let mut builder = ChartBuilder::on(panel);
    builder
        .caption(&chart.title, (FONT, 18))
        .margin(10)
        .margin_right(24)
        .x_label_area_size(LINE * (name_lines(chart) + chart.series.len() as u32 + 1))
        .y_label_area_size(70);
    if is_logarithmic {
        let room = (high / low).max(1.1).powf(ROOM);
        let (low, high) = (low / room, high * room);
        let span = (low..high).log_scale().with_key_points(marks(low, high));
        curves(chart, panel, builder.build_cartesian_2d(left..right, span)?, low)?;
    } else {
        let room = ROOM * (high - low);
        let span = low - room..high + room;
        curves(chart, panel, builder.build_cartesian_2d(left..right, span)?, low - room)?;
    }
    Ok(())
}

fn curves<'a, Y>(
    chart: &Chart,
    panel: &DrawingArea<SVGBackend<'a>, plotters::coord::Shift>,
    mut area: ChartContext<'_, SVGBackend<'a>, Cartesian2d<RangedCoordf64, Y>>,
    low: f64,
) -> Drawn
where
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let mut mesh = area.configure_mesh();
    mesh.y_desc(chart.y.label()).axis_desc_style((FONT, 15)).label_style((FONT, 14));
    mesh.y_label_formatter(&|value| format!("{value}"));
    mesh.light_line_style(TRANSPARENT).bold_line_style(GRID).y_labels(7);
    if chart.x.categories.is_empty() {
        mesh.x_desc(chart.x.label()).x_labels(9);
    } else {
        mesh.disable_x_mesh().x_labels(0);
    }
    mesh.draw()?;
    let (left, right) = (area.x_range().start, area.x_range().end);
    for series in &chart.series {
        let ink = rgb(series.colour);
        if let Some(value) = level(series) {
            let across = [(left, value), (right, value)];
            area.draw_series(DashedLineSeries::new(across, DASH.0, DASH.1, ink.stroke_width(2)))?;
        }
        for curve in &series.curves {
            let shown = || curve.iter().copied().filter(|(_, y)| y.is_finite() && low <= *y);
            match series.mark {
                Mark::Dashed => {
                    let dashed =
                        DashedLineSeries::new(shown(), DASH.0, DASH.1, ink.stroke_width(2));
                    area.draw_series(dashed)?;
                }
                Mark::Line | Mark::Marked | Mark::Steps => {
                    area.draw_series(LineSeries::new(shown(), ink.stroke_width(2)))?;
                }
                Mark::Dots | Mark::Rings | Mark::Crosses | Mark::Band | Mark::Level(_) => {}
            }
            if matches!(series.mark, Mark::Marked | Mark::Dots | Mark::Rings | Mark::Crosses) {
                area.draw_series(shown().map(|point| Circle::new(point, 4, ink.filled())))?;
            }
        }
    }
    let corner = panel.get_base_pixel();
    let at = |x: f64| {
        let (x, y) = area.backend_coord(&(x, low));
        (x - corner.0, y - corner.1)
    };
    let (edge, bottom) = at(left);
    let below = |index: u32| bottom + 8 + (LINE * index) as i32;
    let centred = (FONT, 14).into_font().color(&BLACK).pos(Pos::new(HPos::Center, VPos::Top));
    for (index, name) in chart.x.categories.iter().enumerate() {
        let (x, _) = at(index as f64);
        for (line, text) in (0..).zip(name.lines()) {
            panel.draw(&Text::new(text.to_owned(), (x, below(line)), centred.clone()))?;
        }
    }
    for (line, series) in (name_lines(chart)..).zip(&chart.series) {
        let ink = rgb(series.colour);
        let y = below(line) + 4;
        let key = [(edge, y + 6), (edge + 22, y + 6)];
        panel.draw(&PathElement::new(key, ink.stroke_width(3)))?;
        let style = (FONT, 14).into_font().color(&BLACK);
        panel.draw(&Text::new(series.name.clone(), (edge + 28, y), style))?;
    }
    Ok(())
}

/// Decades beyond which only powers of ten are marked.
const WIDE_SPAN: f64 = 2.5;

/// Marks of a logarithmic axis: powers of ten, and two and five times those on a short axis.
fn marks(low: f64, high: f64) -> Vec<f64> {
    let steps: &[f64] = if WIDE_SPAN < (high / low).log10() { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let decades = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let all = decades.flat_map(|k| steps.iter().map(move |step| step * 10_f64.powi(k)));
    all.filter(|mark| (low..=high).contains(mark)).collect()
}

fn level(series: &Series) -> Option<f64> {
    if let Mark::Level(value) = series.mark { Some(value) } else { None }
}

fn points(chart: &Chart) -> impl Iterator<Item = (f64, f64)> {
    let all = chart.series.iter().flat_map(|series| series.curves.iter().flatten().copied());
    all.filter(|(x, y)| x.is_finite() && y.is_finite())
}

/// Smallest and largest value, never the same.
fn ends(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    });
    match (low.is_finite(), low < high) {
        (false, _) => (1.0, 2.0),
        (true, true) => (low, high),
        (true, false) => (low - 0.1 * low.abs() - 1e-300, low + 0.1 * low.abs() + 1e-300),
    }
}

/// Colours of the page in light mode.
fn rgb(colour: Colour) -> RGBColor {
    match colour {
        Colour::Ink => RGBColor(29, 39, 51),
        Colour::Grey => RGBColor(120, 128, 138),
        Colour::Blue => RGBColor(31, 105, 180),
        Colour::Orange => RGBColor(222, 110, 20),
        Colour::Green => RGBColor(44, 140, 70),
        Colour::Purple => RGBColor(126, 80, 168),
        Colour::Red => RGBColor(196, 50, 50),
        Colour::Teal => RGBColor(20, 140, 145),
        Colour::Olive => RGBColor(130, 130, 30),
        Colour::Pink => RGBColor(205, 90, 150),
        Colour::Brown => RGBColor(130, 90, 60),
        Colour::Gold => RGBColor(190, 145, 20),
    }
}

#[cfg(test)]
mod tests {
    use super::{super::Axis, *};

    fn chart(y: Axis) -> Chart {
        let names = vec!["given".to_owned(), "+ drive\ndelay".to_owned()];
        Chart::of_lines("Residual", Axis::of_categories("step", names), y)
            .with(Series::level("noise floor", Colour::Grey, 1.0))
            .with(Series::marked("motor a", Colour::Blue, vec![(0.0, 64.0), (1.0, 0.9)]))
    }

    #[test]
    fn a_figure_holds_titles_names_legend_and_curves() {
        for y in [Axis::new("RMS / floor", ""), Axis::new("RMS / floor", "").logarithmic()] {
            let svg = figure(&[chart(y.clone()), chart(y.clone())]).unwrap();
            for text in
                ["Residual", "RMS / floor", "given", "+ drive", "delay", "motor a", "noise floor"]
            {
                assert_eq!(svg.matches(&format!("\n{text}\n")).count(), 2, "{text}\n{svg}");
            }
            assert_eq!(svg.matches("<circle").count(), 4);
            assert_eq!(svg, figure(&[chart(y.clone()), chart(y)]).unwrap());
        }
    }

    #[test]
    fn a_figure_without_finite_values_is_drawn_empty() {
        let empty =
            Chart::of_lines("empty", Axis::new("t", "s"), Axis::new("x", "m").logarithmic())
                .with(Series::line("x", Colour::Blue, vec![(0.0, f64::NAN)]));
        assert!(figure(&[empty]).unwrap().contains("empty"));
    }
}
