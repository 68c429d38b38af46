use super::*;

#[test]
fn plots_survive_empty_constant_and_non_finite_data() {
    let curve =
        |points: Vec<(f64, f64)>| Curve { colour: [0, 0, 0], stroke: Stroke::Dashed, points };
    for scale in [Scale::Linear, Scale::Logarithmic] {
        for points in [vec![], vec![(0.0, 0.0)], vec![(0.0, 1.0), (1.0, f64::NAN), (2.0, 1.0)]] {
            let plot = LinePlot {
                title: "t".into(),
                x: "x (s)".into(),
                y: Axis { label: "y (m)".into(), scale },
                bands: vec![],
                curves: vec![curve(points)],
                size: (400, 300),
            };
            assert!(line_plot(&plot).starts_with("<svg"));
        }
    }
    let map = HeatMap {
        title: "t".into(),
        x: "x".into(),
        y: "y".into(),
        x_range: (-1.0, 1.0),
        y_range: (-1.0, 1.0),
        values: vec![vec![f64::NAN, 2.0]],
        cells: vec![vec![String::new(), "two".into()]],
        size: (400, 300),
    };
    let svg = heat_map(&map);
    assert!(svg.contains("<rect") && svg.contains("two"));
}

#[test]
fn a_path_has_one_scale() {
    let square = vec![(0.0, 0.0), (0.3, 0.0), (0.3, 0.3), (0.0, 0.3), (0.0, 0.0)];
    let plot = LinePlot {
        title: "t".into(),
        x: "x (m)".into(),
        y: Axis { label: "y (m)".into(), scale: Scale::Linear },
        bands: vec![],
        curves: vec![Curve { colour: [9, 8, 7], stroke: Stroke::Solid, points: square }],
        size: (900, 400),
    };
    let svg = path_plot(&plot);
    let line = svg.split("<polyline").find(|part| part.contains("#090807")).unwrap();
    let points = line.split("points=\"").nth(1).unwrap().split('"').next().unwrap();
    let points: Vec<Vec<f64>> = points
        .split_whitespace()
        .map(|point| point.split(',').map(|part| part.parse().unwrap()).collect())
        .collect();
    let side = points[1][0] - points[0][0];
    assert!(100.0 < side && (points[1][1] - points[2][1] - side).abs() <= 1.0, "{points:?}");
    let nothing = LinePlot { curves: vec![], ..plot };
    assert!(path_plot(&nothing).starts_with("<svg"));
}

#[test]
fn tick_labels_are_short() {
    let labels = [-1e-17, 0.25, -0.5, 1e-4, 2000.0].map(short);
    assert_eq!(labels, ["0", "0.25", "-0.5", "1e-4", "2000"]);
}
