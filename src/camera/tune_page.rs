//! Page of a colour model: marks and detections on the images, classes of the pixels, colours of the classes.

use super::{
    color::{ColorCount, Kind},
    detector::{Detector, DetectorDocument},
    frame::Frame,
    shot::Shot,
    tune::Mark,
};
use crate::{
    provenance::Provenance,
    report::{Axis, Badge, Chart, Colour, Page, Series, Table, pictures},
};
use serde::Serialize;

/// Most images on a page.
const MOST_IMAGES: usize = 3;
/// Fraction of the marks that the detector must find.
const FEWEST_FOUND: f64 = 0.9;
/// Radius of the rings around marks and detections (pixels).
const RING_PX: [f64; 2] = [14.0, 18.0];
/// Brightness of the background in the image of the classes.
const BACKGROUND_GAIN: f64 = 0.4;
/// Levels of a step of the histograms.
const STEP_LEVELS: f64 = 8.0;
/// Steps of a histogram.
const STEPS: usize = 32;

/// Colours of the classes, and the same as red, green and blue.
const CLASSES: [(Kind, Colour, [u8; 3]); 3] = [
    (Kind::Ball, Colour::Orange, [242, 151, 75]),
    (Kind::Striker, Colour::Red, [240, 80, 80]),
    (Kind::Biscuit, Colour::Green, [98, 196, 134]),
];

/// A mark with the distance of the nearest detection of its kind (pixels), if one lies near it.
pub type CheckedMark = (Mark, Option<f64>);

/// Result of the detector on one marked image.
#[derive(Debug, Clone)]
pub struct ImageResult {
    /// Number of the image, from 0.
    pub image: usize,
    /// Marks.
    pub marks: Vec<CheckedMark>,
    /// Pixels of all detections.
    pub detections: Vec<(Kind, [f64; 2])>,
    /// The image and its classes, where they were kept.
    pub shots: Option<TunedImage>,
}

/// Result of the detector on all marks that its colours were fitted to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FoundMarks {
    /// Number of marks.
    pub marks: usize,
    /// Number of marks with a detection of their kind nearby.
    pub found: usize,
    /// Root mean square of the distances of these detections (pixels).
    pub rms_px: f64,
}

impl FoundMarks {
    /// Sum up the results on all images.
    #[must_use]
    pub fn of(results: &[ImageResult]) -> Self {
        let marks = || results.iter().flat_map(|own| &own.marks);
        let squares: Vec<f64> = marks().filter_map(|own| Some(own.1?.powi(2))).collect();
        let found = squares.len();
        let rms_px = (squares.iter().sum::<f64>() / found.max(1) as f64).sqrt();
        Self { marks: marks().count(), found, rms_px }
    }

    /// Return whether the detector has found nine marks of ten.
    #[must_use]
    pub fn are_enough(&self) -> bool {
        FEWEST_FOUND * self.marks as f64 <= self.found as f64
    }
}

/// A marked image and the classes of its pixels.
#[derive(Debug, Clone)]
pub struct TunedImage {
    plain: Shot,
    classes: Shot,
}

impl TunedImage {
    /// Keep a frame that the detector has seen last, if the page has room for image `number`.
    #[must_use]
    pub fn of(frame: &Frame, detector: &Detector, number: usize) -> Option<Self> {
        if MOST_IMAGES <= number {
            return None;
        }
        let view = frame.view();
        let classes = Shot::changed(frame, |column, row, rgb| {
            let is_searched = detector.searches([column as f64, row as f64]);
            let kind = detector.kind_of(view.yuv(column, row)).filter(|_| is_searched);
            let class = CLASSES.iter().find(|(own, ..)| Some(*own) == kind);
            class.map_or_else(
                || rgb.map(|own| (f64::from(own) * BACKGROUND_GAIN) as u8),
                |(.., color)| *color,
            )
        });
        Some(Self { plain: Shot::of(frame)?, classes: classes? })
    }
}

/// Return the page of a detector: results on the marked images, and the pixels of background, ball, strikers and
/// biscuits.
#[must_use]
pub fn tune_page(
    document: &DetectorDocument,
    results: &[ImageResult],
    pixels: [u64; 4],
    provenance: &Provenance,
) -> String {
    let mut page = Page::new("Detector");
    let summary = FoundMarks::of(results);
    let found = format!("{} of {}", summary.found, summary.marks);
    let tone = if summary.are_enough() { Badge::Good } else { Badge::Bad };
    page.badge(&format!("{found} marked pieces found"), tone);
    page.lead(
        "The detector was run on the marked images that its colours were fitted to. So the result is optimistic: check \
         it on other images with klasktron detect.",
    );
    page.key_figures(&[
        ("marked images", results.len().to_string()),
        ("marked pieces found", found),
        ("distance from the marks (RMS)", format!("{:.2} px", summary.rms_px)),
    ]);
    if !summary.are_enough() {
        page.warning(
            "Fewer than 90 % of the marks were found. Check that every piece of the marked images is marked at its \
             middle, and mark more images.",
        );
    }
    images(&mut page, results);
    classes(&mut page, results);
    colors(&mut page, document, pixels);
    result_table(&mut page, results);
    page.section("Provenance");
    page.code(&provenance.command_line);
    page.paragraph(&format!("klasktron {} ({})", provenance.crate_version, provenance.git_hash));
    page.finish()
}

fn images(page: &mut Page, results: &[ImageResult]) {
    page.section("Marks and detections");
    page.paragraph("A red ring is a mark without a detection. A golden ring without a mark is a false detection.");
    let shown = results.iter().filter_map(|own| {
        let shot = &own.shots.as_ref()?.plain;
        let mut picture = shot
            .picture(&format!("Image {}", own.image))
            .with_entry("mark, found", Colour::Green)
            .with_entry("mark, missed", Colour::Red)
            .with_entry("detection", Colour::Gold);
        for (mark, distance) in &own.marks {
            let colour = if distance.is_some() { Colour::Green } else { Colour::Red };
            picture.ring(mark.pixel, RING_PX[0], colour);
        }
        own.detections.iter().for_each(|own| picture.ring(own.1, RING_PX[1], Colour::Gold));
        Some(picture)
    });
    page.widget(&pictures(&shown.collect::<Vec<_>>()));
}

fn classes(page: &mut Page, results: &[ImageResult]) {
    page.section("Classes of the pixels");
    page.paragraph(
        "A pixel of the field has the colour of a class whose membership exceeds one half; the others are darkened. The \
         detector searches the field only, without the goal cups. Scattered pixels do no harm: a candidate is full of its \
         colour and has a ring of other colours around it.",
    );
    let shown = results.iter().filter_map(|own| {
        let shot = &own.shots.as_ref()?.classes;
        let picture = shot.picture(&format!("Image {}", own.image));
        let entries = CLASSES.iter();
        Some(entries.fold(picture, |own, (kind, colour, _)| own.with_entry(kind.name(), *colour)))
    });
    page.widget(&pictures(&shown.collect::<Vec<_>>()));
}

fn colors(page: &mut Page, document: &DetectorDocument, pixels: [u64; 4]) {
    page.section("Colours of the classes");
    page.paragraph(
        "Fraction of the marked pixels of a class by brightness Y and chroma U (blue) and V (red), 0 to 255. Classes \
         that overlap in all three channels are confused.",
    );
    let colors = &document.colors;
    let all = [
        ("background", Colour::Grey, &colors.background, pixels[0]),
        ("ball", Colour::Orange, &colors.ball, pixels[1]),
        ("striker", Colour::Red, &colors.striker, pixels[2]),
        ("biscuit", Colour::Green, &colors.biscuit, pixels[3]),
    ];
    let shown = || all.iter().filter(|own| 0 < own.3);
    let chart = |channel: usize, name: &str| {
        let x = Axis::new(name, "").within(0.0, 255.0);
        let y = Axis::new("fraction of the pixels", "").including(0.0);
        let series = shown().map(|(name, colour, counts, _)| {
            Series::steps(name, *colour, histogram(counts, channel))
        });
        Chart::of_lines(name, x, y).with_all(series).in_group("levels")
    };
    page.charts(&[chart(0, "brightness Y"), chart(1, "chroma U"), chart(2, "chroma V")]);
    let rows = shown().map(|(name, _, counts, pixels)| {
        vec![(*name).to_owned(), pixels.to_string(), counts.len().to_string()]
    });
    page.table(&Table::new(&["class", "pixels", "distinct colours"], rows.collect()));
}

/// Fractions of the pixels by the level of one channel.
fn histogram(counts: &[ColorCount], channel: usize) -> Vec<(f64, f64)> {
    let mut bins = [0.0; STEPS];
    for ColorCount(steps, count) in counts {
        bins[usize::from(steps[channel]).min(STEPS - 1)] += f64::from(*count);
    }
    let all = bins.iter().sum::<f64>().max(1.0);
    bins.iter().enumerate().map(|(k, own)| (STEP_LEVELS * k as f64, own / all)).collect()
}

fn result_table(page: &mut Page, results: &[ImageResult]) {
    page.section("Results by image");
    let rows = results.iter().map(|own| {
        let distances: Vec<f64> = own.marks.iter().filter_map(|(_, distance)| *distance).collect();
        let worst = distances.iter().copied().fold(0.0, f64::max);
        let missed: Vec<String> = own
            .marks
            .iter()
            .filter(|(_, distance)| distance.is_none())
            .map(|(Mark { kind, pixel: [column, row] }, _)| {
                format!("{} at {column:.0}, {row:.0}", kind.name())
            })
            .collect();
        let missed = if missed.is_empty() { "-".to_owned() } else { missed.join("; ") };
        let found = format!("{} of {}", distances.len(), own.marks.len());
        vec![own.image.to_string(), found, format!("{worst:.2}"), missed]
    });
    let head = ["image", "found", "largest distance (px)", "missed"];
    page.table_of_words(&Table::new(&head, rows.collect()));
}
