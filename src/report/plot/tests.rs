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
fn a_logarithmic_axis_has_marks_at_any_width() {
    assert_eq!(decades(0.3, 700.0).2, [1.0, 10.0, 100.0]);
    assert_eq!(decades(1.5, 30.0).2, [2.0, 5.0, 10.0, 20.0]);
    let (low, high, ticks) = decades(0.9, 1.1);
    assert_eq!((low, high, ticks), (0.5, 2.0, vec![0.5, 1.0, 2.0]));
    let plot = StepPlot {
        title: "t".into(),
        y: "ratio".into(),
        steps: vec![vec!["as given".into()], vec!["+ a".into(), "b".into()]],
        level: 1.0,
        curves: vec![Curve {
            colour: [1, 2, 3],
            stroke: Stroke::Solid,
            points: vec![(0.0, 9.0), (1.0, f64::NAN)],
        }],
        size: (400, 300),
    };
    let svg = step_plot(&plot);
    assert!(svg.contains("as given") && svg.contains("#010203"));
    assert!(step_plot(&StepPlot { steps: vec![], curves: vec![], ..plot }).starts_with("<svg"));
}

#[test]
fn tick_labels_are_short() {
    let labels = [-1e-17, 0.25, -0.5, 1e-4, 2000.0].map(short);
    assert_eq!(labels, ["0", "0.25", "-0.5", "1e-4", "2000"]);
}
