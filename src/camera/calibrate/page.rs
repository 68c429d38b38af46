//! Page of a calibration: parameters with intervals, reprojection errors on the images, pose of the table.

use super::{BoardView, LensCalibration};
use crate::{
    camera::{CameraDocument, CameraModel, Lens, MeasuredPoint, shot::Shot},
    provenance::Provenance,
    report::{Axis, Badge, Chart, Colour, Page, Picture, Series, Table, pictures},
};

/// Largest reprojection error of a usable calibration (pixels).
pub const LARGEST_REPROJECTION_PX: f64 = 1.0;
/// Length on the page of an arrow whose error is the root mean square (pixels).
const ARROW_PX: f64 = 30.0;
/// Points along each side of the field's outline.
const OUTLINE_POINTS: usize = 24;
/// Length of the drawn axes of the board frame (m).
const AXIS_M: f64 = 0.05;

/// Images that a lens was fitted to.
#[derive(Debug)]
pub struct LensImages<'a> {
    /// The fit.
    pub calibration: &'a LensCalibration,
    /// Corners of each image.
    pub views: &'a [BoardView],
    /// The images, where they were kept.
    pub shots: &'a [Option<Shot>],
}

/// Return the page of a calibration: `board` is an image of the table, and `half_field` are half the sides of the field
/// (m).
#[must_use]
pub fn calibration_page(
    document: &CameraDocument,
    lens: Option<&LensImages<'_>>,
    (board, half_field): (Option<&Shot>, [f64; 2]),
    provenance: &Provenance,
) -> String {
    let mut page = Page::new("Camera calibration");
    badge(&mut page, document);
    page.lead(
        "The reprojection error is the distance between a measured point and the projection of its known position. The \
         model is that of OpenCV: a pinhole with radial and tangential distortion.",
    );
    page.key_figures(&key_figures(document));
    if let Some(lens) = lens {
        errors(&mut page, lens);
        worst_image(&mut page, lens);
        coverage(&mut page, lens);
    }
    lens_table(&mut page, document);
    if let Ok(camera) = document.camera() {
        pose(&mut page, document, &camera, (board, half_field));
    }
    page.section("Provenance");
    page.code(&provenance.command_line);
    page.paragraph(&format!("klasktron {} ({})", provenance.crate_version, provenance.git_hash));
    page.finish()
}

fn badge(page: &mut Page, document: &CameraDocument) {
    let lens = document.lens_fit.as_ref().map(|own| own.reprojection_rms_px);
    let board = document.board_fit.as_ref().map(|own| own.reprojection_rms_px);
    let worst = lens.into_iter().chain(board).fold(0.0, f64::max);
    if worst <= LARGEST_REPROJECTION_PX {
        page.badge(&format!("reprojection error {worst:.2} px"), Badge::Good);
    } else {
        let limit = LARGEST_REPROJECTION_PX;
        page.badge(&format!("reprojection error {worst:.2} px, above {limit:.0} px"), Badge::Bad);
    }
}

fn key_figures(document: &CameraDocument) -> Vec<(&'static str, String)> {
    let mut figures =
        vec![("image size", format!("{} x {} px", document.width_px, document.height_px))];
    if let Some(fit) = &document.lens_fit {
        figures.push(("lens, reprojection RMS", format!("{:.3} px", fit.reprojection_rms_px)));
        figures.push(("images, corners", format!("{}, {}", fit.images, fit.corners)));
    }
    if let Some(fit) = &document.board_fit {
        figures
            .push(("board pose, reprojection RMS", format!("{:.3} px", fit.reprojection_rms_px)));
        let half = 1e3 * fit.ci95_half_width_m;
        figures.push(("positions on the field (95 %)", format!("± {half:.2} mm")));
    }
    figures
}

/// Errors (pixels) of all corners of an image: projected minus measured.
fn errors_of(lens: &LensImages<'_>, image: usize) -> Vec<[f64; 2]> {
    let view = &lens.views[image];
    let projected = lens.calibration.project(image, view);
    let pairs = projected.iter().zip(&view.pixels);
    pairs.map(|(a, b)| [a[0] - b[0], a[1] - b[1]]).collect()
}

fn errors(page: &mut Page, lens: &LensImages<'_>) {
    page.section("Reprojection errors");
    page.paragraph(
        "A cloud that is not centred, or arms in one direction, shows a board that is not flat, a wrong size of the \
         squares, or motion blur. An image far above the others should be taken again.",
    );
    let all = (0..lens.views.len()).flat_map(|image| errors_of(lens, image));
    let cloud: Vec<(f64, f64)> = all.map(|[x, y]| (x, y)).collect();
    let largest =
        cloud.iter().map(|(x, y)| x.abs().max(y.abs())).fold(0.0, f64::max).max(1e-3) * 1.1;
    let axis = |name: &str| Axis::new(name, "px").within(-largest, largest);
    let of_images: Vec<(f64, f64)> =
        lens.calibration.rms_px.iter().enumerate().map(|(k, rms)| (k as f64, *rms)).collect();
    let rms = lens.calibration.fit.reprojection_rms_px;
    page.charts(&[
        Chart::of_plane("Error of each corner", axis("column"), axis("row").reversed())
            .with_equal_axes()
            .with(Series::dots("corner", Colour::Blue, cloud)),
        Chart::of_lines(
            "Root mean square of each image",
            Axis::new("image with the board, from 0", ""),
            Axis::new("reprojection error", "px").including(0.0),
        )
        .with(Series::marked("image", Colour::Blue, of_images))
        .with(Series::level("all images", Colour::Grey, rms)),
    ]);
}

/// Magnification of arrows: the root mean square becomes about [`ARROW_PX`] long; 1, 2 or 5 times a power of ten.
fn magnification(rms_px: f64) -> f64 {
    let wanted = ARROW_PX / rms_px.max(1e-6);
    let power = 10_f64.powf(wanted.log10().floor());
    let digit = [5.0, 2.0, 1.0].into_iter().find(|own| own * power <= wanted);
    (digit.unwrap_or(1.0) * power).max(1.0)
}

fn worst_image(page: &mut Page, lens: &LensImages<'_>) {
    let rms = &lens.calibration.rms_px;
    let kept = (0..lens.views.len()).filter(|image| lens.shots[*image].is_some());
    let Some(worst) = kept.max_by(|a, b| rms[*a].total_cmp(&rms[*b])) else { return };
    let Some(shot) = &lens.shots[worst] else { return };
    let times = magnification(rms[worst]);
    page.section("Image with the largest error");
    let caption =
        format!("Image {worst}: {:.3} px (RMS); errors {times:.0} times as long", rms[worst]);
    let mut picture = shot
        .picture(&caption)
        .with_entry("measured corner", Colour::Green)
        .with_entry("error", Colour::Red);
    for (pixel, error) in lens.views[worst].pixels.iter().zip(errors_of(lens, worst)) {
        picture.ring(*pixel, 5.0, Colour::Green);
        let end = [0, 1].map(|axis: usize| pixel[axis] + times * error[axis]);
        picture.arrow(*pixel, end, Colour::Red);
    }
    page.widget(&pictures(&[picture]));
}

fn coverage(page: &mut Page, lens: &LensImages<'_>) {
    page.section("Coverage of the image");
    page.paragraph(
        "Corners of all images. Where there are none, the distortion is extrapolated: take images with the board there.",
    );
    let [width, height] = lens.calibration.size_px.map(|side| side as f64);
    let corners = lens.views.iter().flat_map(|view| &view.pixels);
    let corners: Vec<(f64, f64)> = corners.map(|own| (own[0], own[1])).collect();
    let columns = Axis::new("column", "px").within(0.0, width);
    let rows = Axis::new("row", "px").within(0.0, height).reversed();
    let fitted = &lens.calibration.lens;
    let bent = |ray: f64| {
        let [x, _] = fitted.pixel([ray, 0.0]);
        (ray * fitted.focal_px[0], x - fitted.principal_point_px[0] - ray * fitted.focal_px[0])
    };
    let reach = 0.5 * width.hypot(height) / fitted.focal_px[0];
    let curve: Vec<(f64, f64)> = (0..=60).map(|k| bent(reach * f64::from(k) / 60.0)).collect();
    page.charts(&[
        Chart::of_plane("Corners of all images", columns, rows)
            .with_equal_axes()
            .with(Series::dots("corner", Colour::Blue, corners)),
        Chart::of_lines(
            "Displacement by the distortion",
            Axis::new("distance from the principal point without distortion", "px"),
            Axis::new("displacement along a row", "px"),
        )
        .with(Series::line("lens", Colour::Blue, curve)),
    ]);
}

fn lens_table(page: &mut Page, document: &CameraDocument) {
    page.section("Lens");
    let Lens { focal_px, principal_point_px, distortion: d } = document.lens();
    let values = [
        ("focal length along columns (px)", focal_px[0], 2),
        ("focal length along rows (px)", focal_px[1], 2),
        ("principal point, column (px)", principal_point_px[0], 2),
        ("principal point, row (px)", principal_point_px[1], 2),
        ("k1", d.k1, 5),
        ("k2", d.k2, 5),
        ("p1", d.p1, 6),
        ("p2", d.p2, 6),
        ("k3", d.k3, 5),
    ];
    let half = document.lens_fit.as_ref().map(|fit| fit.ci95_half_width);
    let row = |(k, (name, value, digits)): (usize, &(&str, f64, usize))| {
        let half = match half.map(|half| half[k]) {
            None => "-".to_owned(),
            // Only k3 may be held at 0.
            Some(0.0) => "not fitted".to_owned(),
            Some(half) => format!("± {half:.digits$}"),
        };
        vec![(*name).to_owned(), format!("{value:.digits$}"), half]
    };
    let rows = values.iter().enumerate().map(row).collect();
    page.table(&Table::new(&["parameter", "value", "95 % interval"], rows));
}

fn pose(
    page: &mut Page,
    document: &CameraDocument,
    camera: &CameraModel,
    (board, half_field): (Option<&Shot>, [f64; 2]),
) {
    page.section("Pose of the table");
    page.paragraph(&format!(
        "The camera is {:.0} mm above the field. Lines show where the calibration has the field and the axes of the \
         board frame.",
        1e3 * camera.height()
    ));
    let error = |point: &MeasuredPoint| {
        let projected = camera.project(point.place_m).unwrap_or(point.pixel_px);
        [0, 1].map(|axis: usize| projected[axis] - point.pixel_px[axis])
    };
    let rms = document.board_fit.as_ref().map_or(0.0, |fit| fit.reprojection_rms_px);
    if let Some(shot) = board {
        let times = magnification(rms);
        let caption = format!("Image of the table; errors {times:.0} times as long");
        let arrow = |point: &MeasuredPoint| error(point).map(|own| times * own);
        let picture = board_picture(shot, &caption, (camera, half_field), document, arrow);
        page.widget(&pictures(&[picture]));
    }
    if document.board_points.is_empty() {
        return;
    }
    let rows = document.board_points.iter().enumerate().map(|(k, point)| {
        let name = point.tag.map_or_else(|| format!("corner {}", k + 1), |id| format!("tag {id}"));
        let [x, y, z] = point.place_m.map(|own| format!("{:.1}", 1e3 * own));
        let [column, row] = point.pixel_px.map(|own| format!("{own:.2}"));
        let [dx, dy] = error(point).map(|own| format!("{own:+.2}"));
        vec![name, x, y, z, column, row, dx, dy]
    });
    let head = [
        "point",
        "x (mm)",
        "y (mm)",
        "z (mm)",
        "column (px)",
        "row (px)",
        "error, column (px)",
        "error, row (px)",
    ];
    page.table(&Table::new(&head, rows.collect()));
}

fn board_picture(
    shot: &Shot,
    caption: &str,
    (camera, half): (&CameraModel, [f64; 2]),
    document: &CameraDocument,
    arrow: impl Fn(&MeasuredPoint) -> [f64; 2],
) -> Picture {
    let mut picture = shot
        .picture(caption)
        .with_entry("measured point", Colour::Green)
        .with_entry("error", Colour::Red)
        .with_entry("field", Colour::Gold)
        .with_entry("x axis", Colour::Pink)
        .with_entry("y axis", Colour::Teal);
    picture.lines(&outline(camera, half), Colour::Gold);
    let project = |x: f64, y: f64| camera.project([x, y, 0.0]);
    for (end, colour) in [([AXIS_M, 0.0], Colour::Pink), ([0.0, AXIS_M], Colour::Teal)] {
        if let (Some(from), Some(to)) = (project(0.0, 0.0), project(end[0], end[1])) {
            picture.arrow(from, to, colour);
        }
    }
    for point in &document.board_points {
        let length = arrow(point);
        picture.ring(point.pixel_px, 8.0, Colour::Green);
        let end = [0, 1].map(|axis: usize| point.pixel_px[axis] + length[axis]);
        picture.arrow(point.pixel_px, end, Colour::Red);
    }
    picture
}

/// Outline of the field in the image.
fn outline(camera: &CameraModel, half: [f64; 2]) -> Vec<[f64; 2]> {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let places = (0..=4 * OUTLINE_POINTS).filter_map(|k| {
        let (side, part) = ((k / OUTLINE_POINTS) % 4, k % OUTLINE_POINTS);
        let share = part as f64 / OUTLINE_POINTS as f64;
        let [a, b] = [corners[side], corners[(side + 1) % 4]];
        let [x, y] = [0, 1].map(|axis: usize| half[axis] * (a[axis] + share * (b[axis] - a[axis])));
        camera.project([x, y, 0.0])
    });
    places.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrows_are_magnified_by_round_numbers() {
        for (rms_px, expected) in [(0.08, 200.0), (0.31, 50.0), (3.0, 10.0), (80.0, 1.0)] {
            assert!((magnification(rms_px) - expected).abs() < 1e-9, "{rms_px}");
        }
    }
}
