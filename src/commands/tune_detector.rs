//! `klasktron tune-detector`: the colours of the pieces from images in which they are marked.

use super::{
    Outcome,
    calibrate_camera::for_each_frame,
    note, print,
    reported_command::ReportedCommand,
    results::{OverwriteArgs, report_of, write_with_report},
    table::parse_within,
    tell,
};
use anyhow::{Context, bail};
use klasktron::{
    board::BoardSize,
    camera::{
        CameraDocument, CameraModel, ColorFit, Detections, Detector, DetectorDocument, FoundMarks,
        Frame, ImageResult, Kind, Mark, Pieces, Predictions, SourceSpec, TunedImage, tune_page,
    },
    provenance::Provenance,
};
use serde::Serialize;
use std::{collections::BTreeMap, fs, path::PathBuf};

/// A detection within this distance of a mark has found it (pixels).
const FOUND_WITHIN_PX: f64 = 6.0;

/// Arguments of `klasktron tune-detector`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron tune-detector images:table --calibration camera.json --marks marks.csv -o detector.json
  klasktron tune-detector images:table --calibration camera.json --mark ball@0:612,340 --mark striker@0:380,352 \\
      --mark striker@0:871,347 --mark biscuit@0:640,210 -o detector.json")]
pub(crate) struct Args {
    /// Images: images:FOLDER, video:FILE or mcap:FILE
    #[arg(value_name = "SOURCE")]
    source: SourceSpec,
    /// Calibration from `klasktron calibrate-camera`
    #[arg(long, value_name = "FILE", default_value = "camera.json")]
    calibration: PathBuf,
    /// Middle of a piece in an image, counted from 0: ball, striker or biscuit (repeatable). Every visible piece of
    /// an image that has a mark must be marked
    #[arg(long, value_name = "KIND@IMAGE:COLUMN,ROW", value_parser = parse_mark)]
    mark: Vec<ImageMark>,
    /// Marks as CSV with the columns image, kind, column_px, row_px
    #[arg(long, value_name = "FILE", required_unless_present = "mark")]
    marks: Option<PathBuf>,
    /// Height of the strikers above the field (mm)
    #[arg(long, value_name = "MM", default_value = "25", value_parser = parse_height)]
    striker_height_mm: f64,
    /// Diameter of the biscuits (mm)
    #[arg(long, value_name = "MM", default_value = "12", value_parser = parse_diameter)]
    biscuit_diameter_mm: f64,
    /// Short side of the field (m)
    #[arg(long, value_name = "M", default_value = "0.32")]
    board_short_side_m: f64,
    /// Long side of the field (m)
    #[arg(long, value_name = "M", default_value = "0.42")]
    board_long_side_m: f64,
    /// Detector file to write; its report gets the same name with the extension .html
    #[arg(short, long, alias = "out", value_name = "FILE", default_value = "detector.json")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print the found fraction and the errors as JSON on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy)]
struct ImageMark {
    image: usize,
    mark: Mark,
}

fn parse_height(text: &str) -> Result<f64, String> {
    parse_within(text, 0.0, 100.0, "mm")
}

fn parse_diameter(text: &str) -> Result<f64, String> {
    parse_within(text, 4.0, 100.0, "mm")
}

fn parse_mark(text: &str) -> Result<ImageMark, String> {
    let wrong = || "must be KIND@IMAGE:COLUMN,ROW, such as ball@0:612,340".to_owned();
    let (kind, place) = text.split_once('@').ok_or_else(wrong)?;
    let (image, pixel) = place.split_once(':').ok_or_else(wrong)?;
    let (column, row) = pixel.split_once(',').ok_or_else(wrong)?;
    image_mark([image, kind, column, row]).ok_or_else(wrong)
}

fn image_mark([image, kind, column, row]: [&str; 4]) -> Option<ImageMark> {
    let kind = Kind::ALL.into_iter().find(|own| own.name() == kind)?;
    let number = |text: &str| text.parse::<f64>().ok().filter(|own| own.is_finite());
    let mark = Mark { kind, pixel: [number(column)?, number(row)?] };
    Some(ImageMark { image: image.parse().ok()?, mark })
}

/// Result document.
#[derive(Debug, Serialize)]
struct Report {
    #[serde(flatten)]
    summary: FoundMarks,
    pixels: Pixels,
}

#[derive(Debug, Serialize)]
struct Pixels {
    background: u64,
    ball: u64,
    striker: u64,
    biscuit: u64,
}

/// Run `klasktron tune-detector`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let page = report_of(&args.output, args.overwrite)?;
    let file = args.calibration.display();
    let text =
        fs::read_to_string(&args.calibration).with_context(|| format!("{file}: cannot read"))?;
    let camera = CameraDocument::from_json(&text).and_then(|own| own.camera());
    let camera = camera.with_context(|| file.to_string())?;
    let board = BoardSize::new(args.board_short_side_m, args.board_long_side_m)?;
    let pieces = Pieces {
        striker_height_m: 1e-3 * args.striker_height_mm,
        biscuit_radius_m: 0.5e-3 * args.biscuit_diameter_mm,
        ..Pieces::default()
    };
    let marks = args.read_marks()?;
    let mut fit = ColorFit::new(&camera, &pieces, board);
    args.visit(&marks, &camera, |frame, marks| Ok(fit.add(frame, marks)?))?;
    let [background, ball, striker, biscuit] = fit.pixels();
    let document = fit.finish()?;
    let results = args.check(&marks, &camera, &document)?;
    let summary = FoundMarks::of(&results);
    let pixels = Pixels { background, ball, striker, biscuit };
    let html = tune_page(
        &document,
        &results,
        [background, ball, striker, biscuit],
        &Provenance::new(args.command_line()),
    );
    let text = serde_json::to_string(&document)? + "\n";
    write_with_report((&args.output, &text), (&page, &html), args.overwrite)?;
    if args.json {
        print(&serde_json::to_string_pretty(&Report { summary, pixels })?)?;
    }
    note(&format!(
        "wrote {} and {}: {} of {} marked pieces found, {:.1} px from their marks (RMS)",
        args.output.display(),
        page.display(),
        summary.found,
        summary.marks,
        summary.rms_px
    ));
    if !summary.are_enough() {
        tell(&format!(
            "warning: the detector finds {} of {} marked pieces; check that every piece of the marked images is \
             marked, at its middle, and mark more images",
            summary.found, summary.marks
        ));
        return Ok(Outcome::Lossy);
    }
    Ok(Outcome::Done)
}

impl Args {
    /// Marks by image.
    fn read_marks(&self) -> anyhow::Result<BTreeMap<usize, Vec<Mark>>> {
        let mut all: Vec<ImageMark> = self.mark.clone();
        if let Some(path) = &self.marks {
            let file = path.display();
            let mut reader =
                csv::Reader::from_path(path).with_context(|| format!("{file}: cannot read"))?;
            let columns = ["image", "kind", "column_px", "row_px"];
            let headers = reader.headers().with_context(|| format!("{file}: cannot read"))?.clone();
            let places = columns.map(|name| headers.iter().position(|own| own.trim() == name));
            let [Some(a), Some(b), Some(c), Some(d)] = places else {
                bail!("{file}: needs the columns {}", columns.join(", "));
            };
            for (number, row) in reader.records().enumerate() {
                let row = row.with_context(|| format!("{file}: row {}", number + 2))?;
                let cell = |at: usize| row.get(at).unwrap_or_default().trim();
                let Some(mark) = image_mark([cell(a), cell(b), cell(c), cell(d)]) else {
                    bail!(
                        "{file}: row {} is no mark; write an image from 0, one of ball, striker, biscuit, and two numbers",
                        number + 2
                    );
                };
                all.push(mark);
            }
        }
        let mut by_image: BTreeMap<usize, Vec<Mark>> = BTreeMap::new();
        all.into_iter().for_each(|own| by_image.entry(own.image).or_default().push(own.mark));
        Ok(by_image)
    }

    /// Pass every marked image to `visit`.
    fn visit(
        &self,
        marks: &BTreeMap<usize, Vec<Mark>>,
        camera: &CameraModel,
        mut visit: impl FnMut(&Frame, &[Mark]) -> anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let mut image = 0;
        let images = for_each_frame(&self.source, |frame| {
            camera.check_size([frame.width_px(), frame.height_px()])?;
            if let Some(marks) = marks.get(&image) {
                visit(frame, marks).with_context(|| format!("image {image}"))?;
            }
            image += 1;
            Ok(())
        })?;
        if let Some(missing) = marks.keys().find(|own| images <= **own) {
            bail!(
                "{}: has {images} images, but image {missing} is marked; images count from 0",
                self.source
            );
        }
        Ok(())
    }

    /// Detect in the marked images.
    fn check(
        &self,
        marks: &BTreeMap<usize, Vec<Mark>>,
        camera: &CameraModel,
        document: &DetectorDocument,
    ) -> anyhow::Result<Vec<ImageResult>> {
        let mut detector = Detector::new(camera, document)?;
        let mut images = marks.keys();
        let mut results = Vec::new();
        self.visit(marks, camera, |frame, marks| {
            let seen = detector.detect(frame, &Predictions::default())?;
            let detections = pixels_of(&seen);
            let checked = marks.iter().map(|mark| (*mark, distance_to(mark, &detections)));
            results.push(ImageResult {
                image: images.next().copied().unwrap_or_default(),
                marks: checked.collect(),
                shots: TunedImage::of(frame, &detector, results.len()),
                detections,
            });
            Ok(())
        })?;
        Ok(results)
    }

    /// Command line without the output file, so that equal results are equal files.
    fn command_line(&self) -> String {
        let marks = self.mark.iter().map(|own| {
            let ImageMark { image, mark: Mark { kind, pixel: [column, row] } } = own;
            format!("{}@{image}:{column},{row}", kind.name())
        });
        ReportedCommand::new("tune-detector")
            .words([&self.source])
            .option("calibration", self.calibration.display())
            .options("mark", marks)
            .options("marks", self.marks.iter().map(|path| path.display()))
            .option("striker-height-mm", self.striker_height_mm)
            .option("biscuit-diameter-mm", self.biscuit_diameter_mm)
            .option("board-short-side-m", self.board_short_side_m)
            .option("board-long-side-m", self.board_long_side_m)
            .into_string()
    }
}

/// Kinds and pixels of all detections of a frame.
fn pixels_of(seen: &Detections) -> Vec<(Kind, [f64; 2])> {
    let ball = seen.ball.iter().map(|own| (Kind::Ball, own.pixel));
    let strikers = seen.left.iter().chain(&seen.right).map(|own| (Kind::Striker, own.pixel));
    let biscuits = seen.biscuits.iter().flatten().map(|own| (Kind::Biscuit, own.pixel));
    ball.chain(strikers).chain(biscuits).collect()
}

/// Distance (pixels) of the nearest detection of the kind of a mark; `None` if none has found it.
fn distance_to(mark: &Mark, detections: &[(Kind, [f64; 2])]) -> Option<f64> {
    let of_kind = detections.iter().filter(|own| own.0 == mark.kind);
    let distances =
        of_kind.map(|(_, pixel)| (pixel[0] - mark.pixel[0]).hypot(pixel[1] - mark.pixel[1]));
    Some(distances.fold(f64::INFINITY, f64::min)).filter(|own| *own < FOUND_WITHIN_PX)
}

#[cfg(test)]
mod tests {
    use super::{super::reported_command::tests::check_reported, Args};

    #[test]
    fn the_command_line_of_a_result_has_every_option_that_it_depends_on() {
        for line in [
            "klasktron tune-detector images:table --calibration lens.json --mark ball@0:612,340.5 \
             --mark striker@1:380,352 --striker-height-mm 20 --biscuit-diameter-mm 11 --board-short-side-m 0.3",
            "klasktron tune-detector images:table --marks marks.csv",
        ] {
            check_reported(line, Args::command_line);
        }
    }
}
