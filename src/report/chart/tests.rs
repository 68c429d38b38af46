use super::*;

fn data(chart: &Chart) -> Value {
    let html = chart.html();
    let json = html.split("application/json\">").nth(1).unwrap().split("</script>").next().unwrap();
    serde_json::from_str(json).unwrap()
}

fn chart() -> Chart {
    Chart::of_lines("t", Axis::new("time", "s"), Axis::new("velocity", "m/s"))
}

#[test]
fn charts_survive_empty_constant_and_non_finite_data() {
    for points in [vec![], vec![(0.0, 0.0)], vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 1.0)]] {
        let found = data(&chart().with(Series::dashed("a", Colour::Blue, points.clone())));
        let y = found["series"][0]["curves"][0]["y"].as_array().unwrap();
        assert_eq!(y.len(), points.len());
    }
    let found =
        data(&chart().with(Series::line("a", Colour::Ink, vec![(0.0, f64::NAN), (3.0, 2.5)])));
    assert_eq!(found["series"][0]["curves"][0]["y"], json!([null, 2.5]));
    assert_eq!(found["x"]["label"], "time (s)");
}

#[test]
fn data_cannot_become_markup() {
    let html = Chart::of_lines("a <b>", Axis::new("</script>", ""), Axis::new("y", ""))
        .with(Series::line("<!-- <script>", Colour::Red, vec![]))
        .html();
    assert!(html.contains("a &lt;b&gt;") && !html.contains("<!--"));
    assert_eq!(html.matches("</script>").count(), 1);
}

#[test]
fn numbers_have_the_digits_that_a_screen_shows() {
    let points: Points = (0..5).map(|k| (0.1 * f64::from(k), (f64::from(k) / 7.0).sin())).collect();
    let found = data(&chart().with(Series::line("a", Colour::Blue, points)));
    let curve = &found["series"][0]["curves"][0];
    assert_eq!(curve["x"], json!({ "s": 0, "d": 0.1, "n": 5 }));
    assert_eq!(curve["y"][1].to_string(), "0.14237");
    let small: Points = vec![(0.0, 1.234_567_89e-9), (1.0, 2e-9), (5.0, 0.0)];
    let found = data(&chart().with(Series::line("a", Colour::Blue, small)));
    assert_eq!(found["series"][0]["curves"][0]["y"][0].as_f64(), Some(1.234_57e-9));
}

#[test]
fn bands_and_error_bars_keep_their_own_positions() {
    let points = vec![(0.0, 1.0), (1.0, 2.0)];
    let same = vec![(0.0, 0.5, 1.5), (1.0, 1.5, 2.5)];
    let series = Series::line("a", Colour::Blue, points.clone()).with_whiskers(same);
    let found = data(&chart().with(series));
    assert_eq!(found["series"][0]["curves"].as_array().unwrap().len(), 1);
    assert_eq!(found["series"][0]["curves"][0]["low"], json!([0.5, 1.5]));
    assert_eq!(found["series"][0]["whiskers"], true);
    let wider = vec![(0.0, 0.5, 1.5), (0.5, 0.5, 1.5), (1.0, 1.5, 2.5)];
    let found = data(&chart().with(Series::line("a", Colour::Blue, points).with_band(wider)));
    assert_eq!(found["series"][0]["curves"].as_array().unwrap().len(), 2);
}

#[test]
fn a_long_curve_keeps_its_extremes() {
    let mut points: Points = (0..50_000).map(|k| (f64::from(k), 0.0)).collect();
    points[31_234].1 = 9.0;
    points[40_001].1 = -3.0;
    let found = thinned(&points);
    assert!(found.len() <= MOST_POINTS);
    assert!(found.contains(&(31_234.0, 9.0)) && found.contains(&(40_001.0, -3.0)));
    assert!(found.windows(2).all(|pair| pair[0].0 < pair[1].0));
}

#[test]
fn compared_charts_share_a_range() {
    let one = |top: f64| chart().with(Series::line("", Colour::Blue, vec![(0.0, 0.0), (1.0, top)]));
    let both = with_same_y(vec![one(1.0), one(3.0)]);
    let ranges: Vec<Value> = both.iter().map(|chart| data(chart)["y"]["range"].clone()).collect();
    assert_eq!(ranges[0], ranges[1]);
    assert!(3.0 < ranges[0][1].as_f64().unwrap());
}

#[test]
fn a_grid_has_its_colour_scale_and_blanks() {
    let grid = Grid::of_numbers(
        vec![vec![1.0, f64::NAN], vec![2.0, 8.0]],
        (0.0, 1.0),
        (0.0, 2.0),
        "RMS (mm)",
    );
    let plane = || Chart::of_plane("t", Axis::new("x", "m"), Axis::new("y", "m"));
    let found = data(&plane().with_grid(grid.clone().within(0.0, 4.0)));
    assert_eq!(found["grid"]["values"], json!([[1, null], [2, 8]]));
    assert_eq!((&found["grid"]["high"], &found["grid"]["clipped"]), (&json!(4), &json!(true)));
    let found = data(&plane().with_grid(grid));
    assert_eq!((&found["grid"]["low"], &found["grid"]["clipped"]), (&json!(1), &Value::Null));
}
