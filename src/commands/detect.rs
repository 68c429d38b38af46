//! `klasktron detect`: positions of the pieces from images, recorded and served to other programs.

use super::{
    Outcome, interrupt, note, print,
    results::{OverwriteArgs, refuse_existing_file},
    table::{DetectorArgs, parse_within},
    tell,
};
use anyhow::Context;
use klasktron::{
    camera::{
        DetectingCamera, FrameImages, FrameWarning, Next, PoseWarning, Seen, SourceSpec,
        write_datagram,
    },
    link::{CameraSender, CameraSpec},
    provenance::{CRATE_VERSION, GIT_HASH},
    recording::{FlushPolicy, RECORDING_METADATA, RecordingWriter, topic},
    units::Nanos,
};
use serde::Serialize;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::atomic::Ordering,
    time::Instant,
};

/// Arguments of `klasktron detect`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron detect --camera v4l2:/dev/video0?exposure_us=4000 --send udp:127.0.0.1:9870 -o detections.mcap
  klasktron detect --camera images:table --calibration camera.json --detector detector.json --json")]
pub(crate) struct Args {
    /// Frames: v4l2:DEVICE, images:FOLDER, video:FILE or mcap:FILE
    #[arg(long, value_name = "SOURCE")]
    camera: SourceSpec,
    #[command(flatten)]
    detector: DetectorArgs,
    /// Address to send detections to: udp:HOST:PORT or unix:PATH
    #[arg(long, value_name = "ADDRESS")]
    send: Option<CameraSpec>,
    /// Recording to write
    #[arg(short, long, alias = "out", value_name = "FILE")]
    output: Option<PathBuf>,
    /// Record every so many frames as JPEG too; 0: none
    #[arg(long, value_name = "COUNT", default_value = "0", requires = "output")]
    frames: u32,
    /// End after this time (s)
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    seconds: Option<f64>,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Print one line of JSON per frame, and the summary as the last one, on stdout
    #[arg(long)]
    json: bool,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    parse_within(text, 0.1, 86_400.0, "s")
}

/// Summary of all frames.
#[derive(Debug, Default, Serialize)]
struct Summary {
    frames: u64,
    ball_found: u64,
    left_found: u64,
    right_found: u64,
    warnings: u64,
    /// Displacement of the table in the image since the calibration, of the last check of the pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pose_shift_px: Option<f64>,
    /// The same on the field (mm).
    #[serde(skip_serializing_if = "Option::is_none")]
    pose_shift_mm: Option<f64>,
    /// From the middle of the exposure to the detections, of a live camera (ms).
    #[serde(skip_serializing_if = "Option::is_none")]
    latency_median_ms: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    latency_p99_ms: Option<f64>,
    /// Time of a detection alone (ms), of all frames.
    detection_median_ms: f64,
    detection_p99_ms: f64,
    /// The same where the whole field was searched, and where regions around predictions were (ms).
    #[serde(skip_serializing_if = "Option::is_none")]
    full_search_median_ms: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    regions_median_ms: Option<f64>,
}

/// Run `klasktron detect` until the source ends, the time is over, or Ctrl-C.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut camera = args.detector.camera(&args.camera)?;
    let sender = args.send.as_ref().map(CameraSender::connect).transpose()?;
    let mut recorder = args.output.as_ref().map(|path| args.recorder(path)).transpose()?;
    let stop = interrupt::raised_by_ctrl_c("stopping")?;
    let begun = Instant::now();
    let mut tally = Tally::default();
    while !stop.load(Ordering::Relaxed)
        && args.seconds.is_none_or(|end| begun.elapsed().as_secs_f64() < end)
    {
        let (next, seen) = camera.next_seen()?;
        for warning in camera.take_warnings() {
            tally.summary.warnings += 1;
            tell(&format!("warning: {warning}"));
            tally.lost |= matches!(
                warning,
                FrameWarning::Source(_) | FrameWarning::Pose(PoseWarning::Moved(_))
            );
        }
        if next == Next::End {
            break;
        }
        let Some(seen) = seen else { continue };
        if let Some(sender) = &sender {
            sender.send(&write_datagram(&seen.detections));
        }
        if let Some(recorder) = &mut recorder {
            args.record(recorder, &camera, &seen, tally.summary.frames)?;
        }
        if args.json {
            print(&serde_json::to_string(&seen.detections)?)?;
        }
        tally.add(&seen, camera.detection_seconds());
    }
    if let Some(shift) = camera.pose_shift() {
        tally.summary.pose_shift_px = Some(shift.shift_px);
        tally.summary.pose_shift_mm = Some(1e3 * shift.shift_m);
    }
    if let Some(recorder) = recorder {
        recorder.finish()?;
    }
    args.tell(tally)
}

/// Counts while frames come in.
#[derive(Debug, Default)]
struct Tally {
    summary: Summary,
    latencies_ms: Vec<f64>,
    detections_ms: Vec<f64>,
    full_ms: Vec<f64>,
    regions_ms: Vec<f64>,
    lost: bool,
}

impl Tally {
    fn add(&mut self, seen: &Seen, seconds: f64) {
        let found = &seen.detections;
        self.summary.frames += 1;
        self.summary.ball_found += u64::from(found.ball.is_some());
        self.summary.left_found += u64::from(found.left.is_some());
        self.summary.right_found += u64::from(found.right.is_some());
        self.detections_ms.push(1e3 * seconds);
        let of_kind =
            if found.searched_everything { &mut self.full_ms } else { &mut self.regions_ms };
        of_kind.push(1e3 * seconds);
        if seen.detected_time != seen.received_time {
            self.latencies_ms.push(1e3 * seen.detected_time.seconds_since(found.capture_time));
        }
    }

    fn finish(mut self) -> Summary {
        let quantile = |values: &mut Vec<f64>, q: f64| {
            values.sort_by(f64::total_cmp);
            values
                .get(((values.len() as f64 * q) as usize).min(values.len().saturating_sub(1)))
                .copied()
        };
        self.summary.latency_median_ms = quantile(&mut self.latencies_ms, 0.5);
        self.summary.latency_p99_ms = quantile(&mut self.latencies_ms, 0.99);
        self.summary.full_search_median_ms = quantile(&mut self.full_ms, 0.5);
        self.summary.regions_median_ms = quantile(&mut self.regions_ms, 0.5);
        self.summary.detection_median_ms = quantile(&mut self.detections_ms, 0.5).unwrap_or(0.0);
        self.summary.detection_p99_ms = quantile(&mut self.detections_ms, 0.99).unwrap_or(0.0);
        self.summary
    }
}

impl Args {
    fn recorder(&self, path: &Path) -> anyhow::Result<RecordingWriter> {
        refuse_existing_file(path, self.overwrite)?;
        let mut writer =
            RecordingWriter::create(path, self.overwrite.existing(), FlushPolicy::EverySecond)?;
        let read = |path: &Path| {
            fs::read_to_string(path).with_context(|| format!("{}: cannot read", path.display()))
        };
        let entries = [
            ("schema_version", "1".to_owned()),
            ("source", "hardware".to_owned()),
            ("session", path.file_stem().unwrap_or_default().to_string_lossy().into_owned()),
            ("robot", "camera only".to_owned()),
            ("camera", self.camera.to_string()),
            ("camera_json", read(&self.detector.calibration)?),
            ("crate_version", CRATE_VERSION.to_owned()),
            ("git_hash", GIT_HASH.to_owned()),
        ];
        let entries: BTreeMap<String, String> =
            entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        writer.metadata(RECORDING_METADATA, entries)?;
        Ok(writer)
    }

    fn record(
        &self,
        writer: &mut RecordingWriter,
        camera: &DetectingCamera,
        seen: &Seen,
        number: u64,
    ) -> anyhow::Result<()> {
        let capture = seen.detections.capture_time;
        let times: [Nanos; 2] = [seen.detected_time, capture];
        writer.write_published(
            topic::CAMERA_DETECTIONS,
            times[0],
            times[1],
            &seen.detections.message(),
        )?;
        writer.write_published(topic::CAMERA_FRAME, times[0], times[1], &seen.frame_message())?;
        if 0 < self.frames && number.is_multiple_of(u64::from(self.frames)) {
            FrameImages::write(writer, times, camera.frame())?;
        }
        Ok(())
    }

    fn tell(&self, tally: Tally) -> anyhow::Result<Outcome> {
        let lost = tally.lost;
        let summary = tally.finish();
        let percent = |found: u64| 1e2 * found as f64 / summary.frames.max(1) as f64;
        note(&format!(
            "{} frames: ball in {:.1} %, left striker in {:.1} %, right striker in {:.1} %; a detection takes {:.2} ms \
             (median), {:.2} ms (99 %)",
            summary.frames,
            percent(summary.ball_found),
            percent(summary.left_found),
            percent(summary.right_found),
            summary.detection_median_ms,
            summary.detection_p99_ms
        ));
        if let (Some(median), Some(p99)) = (summary.latency_median_ms, summary.latency_p99_ms) {
            note(&format!(
                "latency from exposure to detection {median:.1} ms (median), {p99:.1} ms (99 %)"
            ));
        }
        if let Some(path) = &self.output {
            note(&format!("wrote {}", path.display()));
        }
        if self.json {
            print(&serde_json::to_string(&summary)?)?;
        }
        Ok(if lost { Outcome::Lossy } else { Outcome::Done })
    }
}
