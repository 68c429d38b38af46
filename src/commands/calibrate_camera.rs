//! `klasktron calibrate-camera`: the lens from a checkerboard, the pose of the table from AprilTags or marked corners.

use super::{
    Outcome, note, print,
    reported_command::ReportedCommand,
    results::{OverwriteArgs, report_of, write_with_report},
    tell,
};
use anyhow::{Context, bail};
use klasktron::{
    board::BoardSize,
    camera::{
        BoardFit, CameraDocument, CameraModel, Frame, FrameSource, Lens, LensFit, MeasuredPoint,
        Next, Shot, SourceSpec,
        calibrate::{
            BoardView, CalibrateError, CharucoBoard, Checkerboard, Dictionary,
            LARGEST_REPROJECTION_PX, LensCalibration, LensImages, MOST_MARKERS, RadialOrder,
            calibrate_lens, calibration_page, find_charuco, find_checkerboard, find_tags,
            fit_board_pose, lens_from_npz, lens_from_yaml,
        },
    },
    provenance::Provenance,
};
use std::{
    collections::BTreeMap,
    fs,
    io::BufReader,
    path::{Path, PathBuf},
};

/// Most images that are kept for the report.
const MOST_SHOTS: usize = 60;

/// Arguments of `klasktron calibrate-camera`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron calibrate-camera --images images:checkerboard --columns 9 --rows 6 --square-mm 22 -o lens.json
  klasktron calibrate-camera --images images:charuco --charuco 5x5 --columns 7 --rows 10 --square-mm 25 \\
      --marker-mm 18 -o lens.json
  klasktron calibrate-camera --lens lens.json --board images:table \\
      --tag 2:-0.140,-0.238 --tag 3:0.140,-0.238 --tag 4:0.140,0.238 --tag 5:-0.140,0.238 -o camera.json
  klasktron calibrate-camera --lens camera_info.yaml \\
      --corner 270,42 --corner 268,610 --corner 1016,612 --corner 1012,45 -o camera.json")]
pub(crate) struct Args {
    /// Images of a checkerboard or a ChArUco board: images:FOLDER, video:FILE, mcap:FILE or v4l2:DEVICE
    #[arg(long, value_name = "SOURCE", required_unless_present = "lens", conflicts_with = "lens")]
    images: Option<SourceSpec>,
    /// Inner corners along the first side of the checkerboard
    #[arg(long, value_name = "COUNT", default_value = "9", value_parser = clap::value_parser!(u8).range(3..=50))]
    columns: u8,
    /// Inner corners along its second side
    #[arg(long, value_name = "COUNT", default_value = "6", value_parser = clap::value_parser!(u8).range(3..=50))]
    rows: u8,
    /// Side of a square (mm)
    #[arg(long, value_name = "MM", default_value = "25", value_parser = parse_square)]
    square_mm: f64,
    /// The board is a ChArUco board of OpenCV with markers of this dictionary: 4x4, 5x5 or 6x6
    #[arg(long, value_name = "DICTIONARY", requires = "marker_mm", conflicts_with = "lens")]
    charuco: Option<Dictionary>,
    /// Side of its markers (mm)
    #[arg(long, value_name = "MM", value_parser = parse_square, requires = "charuco")]
    marker_mm: Option<f64>,
    /// Fit the sixth-order radial coefficient k3 too, for very wide lenses
    #[arg(long)]
    k3: bool,
    /// Known lens: camera.json, a camera_info YAML of ROS or OpenCV, or calibration_data.npz
    #[arg(long, value_name = "FILE")]
    lens: Option<PathBuf>,
    /// Columns and rows of the images, for a lens file that does not say them
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    size: Option<Size>,
    /// Images of the table with AprilTags 36h11
    #[arg(long, value_name = "SOURCE", requires = "tag")]
    board: Option<SourceSpec>,
    /// Place of the centre of a tag in the board frame (m): ID:X,Y or ID:X,Y,Z (repeatable)
    #[arg(long, value_name = "ID:X,Y", value_parser = parse_tag, allow_hyphen_values = true, requires = "board")]
    tag: Vec<TagPlace>,
    /// Pixel of a corner of the field (column,row), four times: x and y negative; x positive; both positive; y positive
    #[arg(long, value_name = "COLUMN,ROW", value_parser = parse_pixel, conflicts_with = "board")]
    corner: Vec<Pixel>,
    /// Short side of the field (m)
    #[arg(long, value_name = "M", default_value = "0.32")]
    board_short_side_m: f64,
    /// Long side of the field (m)
    #[arg(long, value_name = "M", default_value = "0.42")]
    board_long_side_m: f64,
    /// Calibration to write; its report gets the same name with the extension .html
    #[arg(short, long, alias = "out", value_name = "FILE", default_value = "camera.json")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print the calibration as JSON on stdout too
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy)]
struct Size([usize; 2]);

#[derive(Debug, Clone, Copy)]
struct TagPlace {
    id: u32,
    place: [f64; 3],
}

#[derive(Debug, Clone, Copy)]
struct Pixel([f64; 2]);

fn parse_square(text: &str) -> Result<f64, String> {
    super::table::parse_within(text, 1.0, 500.0, "mm")
}

fn parse_size(text: &str) -> Result<Size, String> {
    let wrong = || "must be WIDTHxHEIGHT, such as 1280x720".to_owned();
    let (width, height) = text.split_once('x').ok_or_else(wrong)?;
    let side = |text: &str| text.parse::<usize>().map_err(|_no_number| wrong());
    Ok(Size([side(width)?, side(height)?]))
}

fn parse_tag(text: &str) -> Result<TagPlace, String> {
    let wrong = || "must be ID:X,Y or ID:X,Y,Z in metres, such as 2:-0.140,-0.238".to_owned();
    let (id, place) = text.split_once(':').ok_or_else(wrong)?;
    let numbers: Option<Vec<f64>> = place.split(',').map(|own| own.parse().ok()).collect();
    let place = match numbers.ok_or_else(wrong)?[..] {
        [x, y] => [x, y, 0.0],
        [x, y, z] => [x, y, z],
        _ => return Err(wrong()),
    };
    if !place.iter().all(|own| own.abs() <= 2.0) {
        return Err("must lie within 2 m of the board's centre".to_owned());
    }
    Ok(TagPlace { id: id.parse().map_err(|_no_number| wrong())?, place })
}

fn parse_pixel(text: &str) -> Result<Pixel, String> {
    let wrong = || "must be COLUMN,ROW in pixels, such as 270,42".to_owned();
    let (column, row) = text.split_once(',').ok_or_else(wrong)?;
    let side = |text: &str| text.trim().parse::<f64>().ok().filter(|own| own.is_finite());
    Ok(Pixel([side(column).ok_or_else(wrong)?, side(row).ok_or_else(wrong)?]))
}

/// Fitted pose of the table.
struct BoardPose {
    camera: CameraModel,
    fit: BoardFit,
    points: Vec<MeasuredPoint>,
    /// First image of the table.
    shot: Option<Shot>,
}

/// Board of the images that a lens is fitted to.
enum CalibrationBoard {
    Plain(Checkerboard),
    Charuco(CharucoBoard),
}

impl CalibrationBoard {
    fn find(&self, frame: &Frame) -> Option<BoardView> {
        match self {
            Self::Plain(board) => Some(board.view(find_checkerboard(frame, board)?)),
            Self::Charuco(board) => find_charuco(frame, board),
        }
    }
}

/// Fitted lens with the images of the fit.
struct FittedLens {
    calibration: LensCalibration,
    views: Vec<BoardView>,
    shots: Vec<Option<Shot>>,
}

impl FittedLens {
    fn images(&self) -> LensImages<'_> {
        let Self { calibration, views, shots } = self;
        LensImages { calibration, views, shots }
    }
}

/// Run `klasktron calibrate-camera`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let page = report_of(&args.output, args.overwrite)?;
    let board = BoardSize::new(args.board_short_side_m, args.board_long_side_m)?;
    let (mut document, lens) = args.lens_document()?;
    let mut board_shot = None;
    if let Some(BoardPose { camera, fit, points, shot }) = args.board_pose(&document, board)? {
        document.rotation_rad = Some(camera.camera_from_board.rotation_vector());
        document.translation_m = Some(camera.camera_from_board.translation);
        note(&format!(
            "the camera is {:.0} mm above the field; {} points, reprojection error {:.2} px (RMS); positions on the \
             field to {:.2} mm (95 %)",
            1e3 * camera.height(),
            fit.points,
            fit.reprojection_rms_px,
            1e3 * fit.ci95_half_width_m
        ));
        (document.board_fit, document.board_points) = (Some(fit), points);
        board_shot = shot;
    }
    let half = [board.short_side / 2.0, board.long_side / 2.0];
    let lens = lens.as_ref().map(FittedLens::images);
    let board = (board_shot.as_ref(), half);
    let html =
        calibration_page(&document, lens.as_ref(), board, &Provenance::new(args.command_line()));
    let text = serde_json::to_string_pretty(&document)? + "\n";
    write_with_report((&args.output, &text), (&page, &html), args.overwrite)?;
    if args.json {
        print(text.trim_end())?;
    }
    note(&format!("wrote {} and {}", args.output.display(), page.display()));
    Ok(args.verdict(&document))
}

impl Args {
    /// The lens, fitted or read.
    fn lens_document(&self) -> anyhow::Result<(CameraDocument, Option<FittedLens>)> {
        if let Some(path) = &self.lens {
            return Ok((self.read_lens(path)?, None));
        }
        let Some(spec) = &self.images else { bail!("give --images or --lens") };
        let fitted = self.fit_lens(spec)?;
        let LensCalibration { size_px, lens, fit, rms_px, .. } = &fitted.calibration;
        tell_lens(lens, fit);
        let worst = rms_px.iter().copied().fold(0.0, f64::max);
        note(&format!("worst image: reprojection error {worst:.2} px (RMS)"));
        let mut document = CameraDocument::new(*size_px, lens, None);
        document.lens_fit = Some(fit.clone());
        Ok((document, Some(fitted)))
    }

    fn fit_lens(&self, spec: &SourceSpec) -> anyhow::Result<FittedLens> {
        let board = self.calibration_board()?;
        let mut size = None;
        let (mut views, mut shots) = (Vec::new(), Vec::new());
        let images = for_each_frame(spec, |frame| {
            let own = [frame.width_px(), frame.height_px()];
            if *size.get_or_insert(own) != own {
                bail!("{spec}: the images differ in size; calibrate with images of one resolution");
            }
            if let Some(view) = board.find(frame) {
                shots.push((views.len() < MOST_SHOTS).then(|| Shot::of(frame)).flatten());
                views.push(view);
            }
            Ok(())
        })?;
        note(&format!("{} of {images} images show the board", views.len()));
        let order = if self.k3 { RadialOrder::Sixth } else { RadialOrder::Fourth };
        let calibrated = calibrate_lens(size.unwrap_or_default(), &views, order);
        let calibration = calibrated.map_err(|error| match error {
            CalibrateError::FewImages { found, .. } => CalibrateError::FewImages { found, images },
            other => other,
        })?;
        Ok(FittedLens { calibration, views, shots })
    }

    fn calibration_board(&self) -> anyhow::Result<CalibrationBoard> {
        let (columns, rows) = (self.columns.into(), self.rows.into());
        let square_m = 1e-3 * self.square_mm;
        let (Some(dictionary), Some(marker_mm)) = (self.charuco, self.marker_mm) else {
            return Ok(CalibrationBoard::Plain(Checkerboard { columns, rows, square_m }));
        };
        if self.square_mm <= marker_mm {
            bail!(
                "--marker-mm is {marker_mm} mm; it must be less than the side of a square, {} mm",
                self.square_mm
            );
        }
        let marker_m = 1e-3 * marker_mm;
        let board = CharucoBoard { columns, rows, square_m, marker_m, dictionary };
        if MOST_MARKERS < board.markers() {
            bail!(
                "a board of {columns} x {rows} inner corners has {} markers, the largest dictionary has \
                 {MOST_MARKERS}; check --columns and --rows",
                board.markers()
            );
        }
        Ok(CalibrationBoard::Charuco(board))
    }

    fn read_lens(&self, path: &Path) -> anyhow::Result<CameraDocument> {
        let file = path.display();
        let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
        if extension == "npz" {
            let source = fs::File::open(path).with_context(|| format!("{file}: cannot open"))?;
            let lens = lens_from_npz(BufReader::new(source)).with_context(|| file.to_string())?;
            return self.sized(path, None, &lens);
        }
        let text = fs::read_to_string(path).with_context(|| format!("{file}: cannot read"))?;
        if extension == "json" {
            return CameraDocument::from_json(&text).with_context(|| file.to_string());
        }
        let (size, lens) = lens_from_yaml(&text).with_context(|| file.to_string())?;
        self.sized(path, size, &lens)
    }

    fn sized(
        &self,
        path: &Path,
        size: Option<[usize; 2]>,
        lens: &Lens,
    ) -> anyhow::Result<CameraDocument> {
        let Some(size) = size.or(self.size.map(|own| own.0)) else {
            bail!(
                "{}: does not say the size of its images; give --size WIDTHxHEIGHT",
                path.display()
            );
        };
        Ok(CameraDocument::new(size, lens, None))
    }

    fn board_pose(
        &self,
        document: &CameraDocument,
        board: BoardSize,
    ) -> anyhow::Result<Option<BoardPose>> {
        let half = [board.short_side / 2.0, board.long_side / 2.0];
        let size = [document.width_px, document.height_px];
        let mut shot = None;
        let points = if let Some(spec) = &self.board {
            self.tag_points(spec, size, &mut shot)?
        } else if self.corner.is_empty() {
            return Ok(None);
        } else {
            if self.corner.len() != 4 {
                bail!(
                    "--corner is given {} times; give the four corners of the field",
                    self.corner.len()
                );
            }
            let signs = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
            let corners = signs.iter().zip(&self.corner);
            corners
                .map(|(sign, pixel)| MeasuredPoint {
                    tag: None,
                    place_m: [sign[0] * half[0], sign[1] * half[1], 0.0],
                    pixel_px: pixel.0,
                })
                .collect()
        };
        let (camera, fit) = fit_board_pose(size, &document.lens(), &points, half)?;
        Ok(Some(BoardPose { camera, fit, points, shot }))
    }

    /// Mean pixels of the known tags; the first image goes to `shot`.
    fn tag_points(
        &self,
        spec: &SourceSpec,
        size: [usize; 2],
        shot: &mut Option<Shot>,
    ) -> anyhow::Result<Vec<MeasuredPoint>> {
        let mut sums: BTreeMap<u32, ([f64; 2], f64)> = BTreeMap::new();
        let images = for_each_frame(spec, |frame| {
            let own = [frame.width_px(), frame.height_px()];
            if own != size {
                bail!(
                    "{spec}: the images have {} x {} pixels, the lens is for {} x {}; calibrate the lens at this \
                     resolution",
                    own[0],
                    own[1],
                    size[0],
                    size[1]
                );
            }
            if shot.is_none() {
                *shot = Shot::of(frame);
            }
            for tag in find_tags(frame) {
                let (sum, count) = sums.entry(tag.id).or_default();
                (0..2).for_each(|axis| sum[axis] += tag.centre[axis]);
                *count += 1.0;
            }
            Ok(())
        })?;
        let known = self.tag.iter().filter_map(|tag| {
            let (sum, count) = sums.get(&tag.id)?;
            let pixel_px = sum.map(|own| own / count);
            Some(MeasuredPoint { tag: Some(tag.id), place_m: tag.place, pixel_px })
        });
        let known: Vec<MeasuredPoint> = known.collect();
        note(&format!("{} of {} tags found in {images} images", known.len(), self.tag.len()));
        Ok(known)
    }

    /// Command line without the output file, so that equal results are equal files.
    fn command_line(&self) -> String {
        let mut line = ReportedCommand::new("calibrate-camera").options("images", &self.images);
        if self.images.is_some() {
            line = line
                .option("columns", self.columns)
                .option("rows", self.rows)
                .option("square-mm", self.square_mm);
        }
        let size = self.size.map(|Size([width, height])| format!("{width}x{height}"));
        let tags =
            self.tag.iter().map(|TagPlace { id, place: [x, y, z] }| format!("{id}:{x},{y},{z}"));
        let corners = self.corner.iter().map(|Pixel([column, row])| format!("{column},{row}"));
        line.options("charuco", self.charuco)
            .options("marker-mm", self.marker_mm)
            .options("lens", self.lens.iter().map(|path| path.display()))
            .options("size", size)
            .options("board", &self.board)
            .options("tag", tags)
            .options("corner", corners)
            .option("board-short-side-m", self.board_short_side_m)
            .option("board-long-side-m", self.board_long_side_m)
            .words(self.k3.then_some("--k3"))
            .into_string()
    }

    /// Status 3 where a reprojection error says that something is wrong.
    fn verdict(&self, document: &CameraDocument) -> Outcome {
        let lens = document.lens_fit.as_ref().filter(|_| self.images.is_some());
        let errors = [
            ("lens", lens.map(|fit| fit.reprojection_rms_px)),
            ("board pose", document.board_fit.as_ref().map(|fit| fit.reprojection_rms_px)),
        ];
        let mut outcome = Outcome::Done;
        for (name, error) in errors {
            if let Some(error) = error.filter(|own| LARGEST_REPROJECTION_PX < *own) {
                tell(&format!(
                    "warning: the {name} has a reprojection error of {error:.2} px, allowed is \
                     {LARGEST_REPROJECTION_PX} px; check the sizes and places that were given"
                ));
                outcome = Outcome::Lossy;
            }
        }
        outcome
    }
}

fn tell_lens(lens: &Lens, fit: &LensFit) {
    let half = fit.ci95_half_width;
    note(&format!(
        "focal length {:.1} x {:.1} px (95 %: +-{:.1}), principal point {:.1}, {:.1} px (+-{:.1}), k1 {:.4} (+-{:.4}), \
         k2 {:.4} (+-{:.4}); reprojection error {:.3} px (RMS of {} corners)",
        lens.focal_px[0],
        lens.focal_px[1],
        half[0].max(half[1]),
        lens.principal_point_px[0],
        lens.principal_point_px[1],
        half[2].max(half[3]),
        lens.distortion.k1,
        half[4],
        lens.distortion.k2,
        half[5],
        fit.reprojection_rms_px,
        fit.corners
    ));
}

/// Pass every frame of a source to `visit`; damaged images are warnings. Return the number of images.
pub(super) fn for_each_frame(
    spec: &SourceSpec,
    mut visit: impl FnMut(&Frame) -> anyhow::Result<()>,
) -> anyhow::Result<usize> {
    /// Frames of a live camera that one calibration takes.
    const LIVE_FRAMES: usize = 60;
    let mut source: Box<dyn FrameSource> = spec.open()?;
    let mut frame = Frame::default();
    let mut count = 0;
    loop {
        match source.next_frame(&mut frame) {
            Ok(Next::Frame) => visit(&frame)?,
            Ok(Next::Nothing) => continue,
            Ok(Next::End) => return Ok(count),
            Err(error) if error.is_single_frame() => tell(&format!("warning: {error}")),
            Err(error) => return Err(error.into()),
        }
        count += 1;
        if source.is_live() && LIVE_FRAMES <= count {
            return Ok(count);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{super::reported_command::tests::check_reported, Args};

    #[test]
    fn the_command_line_of_a_result_has_every_option_that_it_depends_on() {
        for line in [
            "klasktron calibrate-camera --images images:board --charuco 5x5 --columns 7 --rows 10 --square-mm 24.5 \
             --marker-mm 18 --k3 --board images:table --tag 2:-0.14,-0.238,0.01 --board-long-side-m 0.44",
            "klasktron calibrate-camera --lens lens.yaml --size 1280x720 --corner 270.5,42 --corner 268,610",
        ] {
            check_reported(line, Args::command_line);
        }
    }
}
