//! Camera of the Linux kernel (Video4Linux2).
//!
//! `v4l2:/dev/video0?size=1280x720&fps=120&format=UYVY&exposure_us=4000&gain=10`; every option may be left out. The
//! format is the first of UYVY, YUYV, MJPG, GREY that the driver offers at this size. `exposure_us` switches the
//! automatic exposure off, so that the exposure is known and frames keep their period.
//!
//! A thread takes mapped buffers from the driver, copies each into one of four reused frames, and hands it over; a
//! reader that is late loses the oldest frames. The kernel's time stamp (monotonic clock) becomes `capture_time`:
//! the stamp is taken at the end of the exposure, so half the exposure is subtracted. A camera that is unplugged is
//! opened again as soon as it is back.
//!
//! Crate `rscam` without its C wrapper: `v4l` generates its bindings with libclang at build time, and `linuxvideo`
//! does not hand out the kernel's time stamps.

use super::{
    FrameSource, Next, SourceError,
    decode::{Scratch, decode_with},
};
use crate::{
    camera::frame::{Frame, PixelFormat},
    units::Nanos,
};
use nix::time::{ClockId, clock_gettime};
use rscam::{Camera, Config, ResolutionInfo};
use std::{
    io,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver, RecvTimeoutError, SyncSender, TryRecvError, TrySendError},
    },
    thread,
    time::Duration,
};

/// Frames between the thread and the reader.
const FRAMES: usize = 4;
/// Buffers of the driver: more of them hide a busy computer, and make a late reader's frames older.
const DRIVER_BUFFERS: u32 = 4;
/// Longest wait for a frame.
const PATIENCE: Duration = Duration::from_millis(100);
/// Pause before an unplugged camera is tried again.
const REOPEN_PAUSE: Duration = Duration::from_millis(500);
/// Formats in order of preference: raw ones need no decoder.
const FORMATS: [&[u8; 4]; 4] = [b"UYVY", b"YUYV", b"MJPG", b"GREY"];
/// Value of V4L2_CID_EXPOSURE_AUTO for manual exposure.
const EXPOSURE_MANUAL: i32 = 1;
/// Unit of V4L2_CID_EXPOSURE_ABSOLUTE (us).
const EXPOSURE_UNIT_US: u32 = 100;
/// Value of V4L2_CID_GAIN. Source: linux/v4l2-controls.h.
const CID_GAIN: u32 = 0x0098_0900 + 19;

/// Settings of a camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct V4l2Config {
    /// Device, such as `/dev/video0`.
    pub device: String,
    /// Columns and rows.
    pub size_px: [u32; 2],
    /// Frames per second.
    pub fps: u32,
    /// Format as four characters; the first that the driver offers when absent.
    pub format: Option<[u8; 4]>,
    /// Exposure time (us), 100 to 100000; the driver's setting when absent.
    pub exposure_us: Option<u32>,
    /// Gain in the driver's unit; its setting when absent.
    pub gain: Option<i32>,
}

impl V4l2Config {
    /// Parse `DEVICE?name=value&...`.
    ///
    /// # Errors
    /// When an option is unknown or its value wrong.
    pub fn parse(text: &str) -> Result<Self, SourceError> {
        let (device, options) = text.split_once('?').unwrap_or((text, ""));
        let mut config = Self {
            device: device.to_owned(),
            size_px: [1280, 720],
            fps: 120,
            format: None,
            exposure_us: None,
            gain: None,
        };
        for option in options.split('&').filter(|option| !option.is_empty()) {
            config.set(option).ok_or_else(|| SourceError::Unusable {
                source_name: format!("v4l2:{text}"),
                what: format!("'{option}' is no option"),
                remedy: "write size=1280x720, fps=1..1000, format=UYVY, exposure_us=100..100000 or gain=NUMBER"
                    .to_owned(),
            })?;
        }
        Ok(config)
    }

    fn set(&mut self, option: &str) -> Option<()> {
        let (name, value) = option.split_once('=')?;
        let within = |low: u32, high: u32| {
            value.parse::<u32>().ok().filter(|own| (low..=high).contains(own))
        };
        match name {
            "size" => {
                let (width, height) = value.split_once('x')?;
                let side =
                    |text: &str| text.parse::<u32>().ok().filter(|own| (16..=16_384).contains(own));
                self.size_px = [side(width).filter(|own| own.is_multiple_of(2))?, side(height)?];
            }
            "fps" => self.fps = within(1, 1000)?,
            "format" => self.format = Some(value.as_bytes().try_into().ok()?),
            "exposure_us" => self.exposure_us = Some(within(100, 100_000)?),
            "gain" => self.gain = Some(value.parse().ok()?),
            _ => return None,
        }
        Some(())
    }

    fn error(&self, what: String, remedy: &str) -> SourceError {
        SourceError::Unusable {
            source_name: format!("v4l2:{}", self.device),
            what,
            remedy: remedy.to_owned(),
        }
    }

    /// Open the device and start its stream.
    fn start(&self) -> Result<(Camera, [u8; 4]), SourceError> {
        let mut camera = Camera::new(&self.device).map_err(|error| {
            let remedy = match error.kind() {
                io::ErrorKind::PermissionDenied => {
                    "add this user to the group `video`, and log in again"
                }
                _ => "check the cable and the name: `ls /dev/video*`",
            };
            self.error(format!("cannot open the camera ({error})"), remedy)
        })?;
        let format = self.choose_format(&camera)?;
        self.set_controls(&camera)?;
        let config = Config {
            interval: (1, self.fps),
            resolution: (self.size_px[0], self.size_px[1]),
            format: &format,
            field: rscam::FIELD_NONE,
            nbuffers: DRIVER_BUFFERS,
        };
        camera.start(&config).map_err(|error| {
            let wanted = format!(
                "{} {}x{} at {} frames per second",
                String::from_utf8_lossy(&format),
                self.size_px[0],
                self.size_px[1],
                self.fps
            );
            let what = format!("the driver refuses {wanted} ({error})");
            self.error(what, &format!("it offers {}", self.offers(&camera)))
        })?;
        Ok((camera, format))
    }

    fn choose_format(&self, camera: &Camera) -> Result<[u8; 4], SourceError> {
        if let Some(format) = self.format {
            return Ok(format);
        }
        let offered: Vec<[u8; 4]> =
            camera.formats().filter_map(|info| Some(info.ok()?.format)).collect();
        FORMATS.into_iter().copied().find(|format| offered.contains(format)).ok_or_else(|| {
            let what = "the camera has none of the formats UYVY, YUYV, MJPG, GREY".to_owned();
            self.error(what, &format!("it offers {}", self.offers(camera)))
        })
    }

    /// Formats with their sizes and rates, for a message.
    fn offers(&self, camera: &Camera) -> String {
        let mut texts = Vec::new();
        for info in camera.formats().flatten() {
            let name = String::from_utf8_lossy(&info.format).into_owned();
            match camera.resolutions(&info.format) {
                Ok(ResolutionInfo::Discretes(sizes)) => {
                    texts.extend(sizes.into_iter().map(|size| {
                        let rates = camera.intervals(&info.format, size);
                        let rates =
                            rates.map_or_else(|_unknown| String::new(), |own| format!(" {own:?}"));
                        format!("{name} {}x{}{rates}", size.0, size.1)
                    }))
                }
                _ => texts.push(name),
            }
        }
        if texts.is_empty() { "nothing".to_owned() } else { texts.join(", ") }
    }

    fn set_controls(&self, camera: &Camera) -> Result<(), SourceError> {
        let refused = |name: &str, error: &io::Error| {
            let remedy = "leave the option out and set it with v4l2-ctl";
            self.error(format!("the driver refuses {name} ({error})"), remedy)
        };
        if let Some(exposure_us) = self.exposure_us {
            camera
                .set_control(rscam::CID_EXPOSURE_AUTO, &EXPOSURE_MANUAL)
                .map_err(|error| refused("manual exposure", &error))?;
            let units = exposure_us.div_ceil(EXPOSURE_UNIT_US) as i32;
            camera
                .set_control(rscam::CID_EXPOSURE_ABSOLUTE, &units)
                .map_err(|error| refused("this exposure", &error))?;
        }
        if let Some(gain) = self.gain {
            camera.set_control(CID_GAIN, &gain).map_err(|error| refused("this gain", &error))?;
        }
        Ok(())
    }
}

type Delivery = Result<Frame, SourceError>;

/// Camera device.
pub struct V4l2Source {
    config: V4l2Config,
    filled: Receiver<Delivery>,
    empty: SyncSender<Frame>,
    stop: Arc<AtomicBool>,
}

impl V4l2Source {
    /// Open a camera and start its thread.
    ///
    /// # Errors
    /// When the device cannot be opened, or the driver refuses the settings; the message lists what it offers.
    pub fn open(config: &V4l2Config) -> Result<Self, SourceError> {
        let started = config.start()?;
        let (to_reader, filled) = mpsc::sync_channel(FRAMES);
        let (empty, from_reader) = mpsc::sync_channel(FRAMES);
        for _ in 0..FRAMES {
            // The channel has room for all frames.
            empty.try_send(Frame::default()).ok();
        }
        let stop = Arc::new(AtomicBool::new(false));
        let worker = Worker {
            config: config.clone(),
            to_reader,
            from_reader,
            stop: Arc::clone(&stop),
            scratch: Scratch::default(),
        };
        // The driver may block for ever in a stalled transfer, so nobody joins this thread.
        thread::Builder::new().name("v4l2".to_owned()).spawn(move || worker.run(started)).map_err(
            |error| {
                config.error(format!("a thread cannot be started ({error})"), "end other programs")
            },
        )?;
        Ok(Self { config: config.clone(), filled, empty, stop })
    }
}

impl FrameSource for V4l2Source {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<Next, SourceError> {
        match self.filled.recv_timeout(PATIENCE) {
            Ok(Ok(new)) => {
                let old = std::mem::replace(frame, new);
                // The thread is gone only when the program ends.
                self.empty.try_send(old).ok();
                Ok(Next::Frame)
            }
            Ok(Err(error)) => Err(error),
            Err(RecvTimeoutError::Timeout) => Ok(Next::Nothing),
            Err(RecvTimeoutError::Disconnected) => {
                Err(self.config.error("its thread has ended".to_owned(), "start anew"))
            }
        }
    }

    fn name(&self) -> String {
        format!("v4l2:{}", self.config.device)
    }

    fn exposure_s(&self) -> Option<f64> {
        self.config.exposure_us.map(|exposure| f64::from(exposure) * 1e-6)
    }

    fn is_live(&self) -> bool {
        true
    }
}

impl Drop for V4l2Source {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

/// Thread that reads the driver.
struct Worker {
    config: V4l2Config,
    to_reader: SyncSender<Delivery>,
    from_reader: Receiver<Frame>,
    stop: Arc<AtomicBool>,
    scratch: Scratch,
}

impl Worker {
    fn run(mut self, started: (Camera, [u8; 4])) {
        let mut started = Some(started);
        while !self.stop.load(Ordering::Relaxed) {
            if let Some((camera, format)) = started.take() {
                self.stream(&camera, format);
            }
            // Unplugged: the device has its old name again as soon as it is back.
            thread::sleep(REOPEN_PAUSE);
            started = self.config.start().ok();
        }
    }

    /// Deliver frames until the camera fails.
    fn stream(&mut self, camera: &Camera, format: [u8; 4]) {
        while !self.stop.load(Ordering::Relaxed) {
            match camera.capture() {
                Ok(buffer) => {
                    let stamp_us = buffer.get_timestamp();
                    self.deliver(&buffer, stamp_us, format);
                }
                Err(error) => {
                    let what = format!("the camera has stopped ({error})");
                    let remedy = "plug it in again; it is opened as soon as it is back";
                    self.to_reader.try_send(Err(self.config.error(what, remedy))).ok();
                    return;
                }
            }
        }
    }

    fn deliver(&mut self, bytes: &[u8], stamp_us: u64, format: [u8; 4]) {
        let mut frame = match self.from_reader.try_recv() {
            Ok(frame) => frame,
            // The reader is late: this frame is left out, so that the next one is fresh.
            Err(TryRecvError::Empty | TryRecvError::Disconnected) => return,
        };
        let now = Clocks::read();
        let middle = self.config.exposure_us.map_or(0, |exposure| u64::from(exposure) * 500);
        frame.received_time = Nanos(now.epoch_ns);
        frame.capture_time = Nanos(now.epoch_of_monotonic(stamp_us * 1000).saturating_sub(middle));
        let size = self.config.size_px.map(|side| side as usize);
        let filled = match &format {
            b"UYVY" => frame.set_packed(size, PixelFormat::Uyvy, bytes).map_err(SourceError::from),
            b"YUYV" => frame.set_packed(size, PixelFormat::Yuyv, bytes).map_err(SourceError::from),
            b"GREY" => frame.set_grey(size, bytes).map_err(SourceError::from),
            _ => decode_with(bytes, &mut frame, &mut self.scratch).map_err(|reason| {
                SourceError::Image {
                    image: format!("a frame of v4l2:{}", self.config.device),
                    reason,
                }
            }),
        };
        let delivery = filled.map(|()| frame);
        match self.to_reader.try_send(delivery) {
            Ok(()) | Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {}
        }
    }
}

/// Readings of both clocks at one moment.
#[derive(Debug, Clone, Copy)]
struct Clocks {
    epoch_ns: u64,
    monotonic_ns: u64,
}

impl Clocks {
    fn read() -> Self {
        let read = |clock: ClockId| {
            clock_gettime(clock)
                .map_or(0, |time| time.tv_sec() as u64 * 1_000_000_000 + time.tv_nsec() as u64)
        };
        Self {
            epoch_ns: read(ClockId::CLOCK_REALTIME),
            monotonic_ns: read(ClockId::CLOCK_MONOTONIC),
        }
    }

    /// Time since the epoch of a monotonic time in the past; drivers without time stamps send 0, which gives now.
    fn epoch_of_monotonic(&self, monotonic_ns: u64) -> u64 {
        const OLDEST_NS: u64 = 1_000_000_000;
        match self.monotonic_ns.checked_sub(monotonic_ns) {
            Some(age) if age < OLDEST_NS => self.epoch_ns.saturating_sub(age),
            _ => self.epoch_ns,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_read_and_wrong_ones_are_named() {
        let config = V4l2Config::parse(
            "/dev/video2?size=640x480&fps=60&format=YUYV&exposure_us=4000&gain=3",
        )
        .unwrap();
        assert_eq!(config.size_px, [640, 480]);
        assert_eq!((config.fps, config.exposure_us, config.gain), (60, Some(4000), Some(3)));
        assert_eq!(config.format, Some(*b"YUYV"));
        for wrong in ["fps=0", "size=641x480", "size=640", "exposure_us=50", "zoom=1", "format=YUV"]
        {
            let error = V4l2Config::parse(&format!("/dev/video0?{wrong}")).unwrap_err().to_string();
            assert!(error.contains(&format!("'{wrong}' is no option")), "{error}");
        }
    }

    #[test]
    fn a_device_that_is_absent_is_named_with_the_way_out() {
        let config = V4l2Config::parse("/dev/no-such-camera").unwrap();
        let error = V4l2Source::open(&config).err().unwrap().to_string();
        assert!(error.starts_with("v4l2:/dev/no-such-camera: cannot open the camera ("), "{error}");
        assert!(error.ends_with("check the cable and the name: `ls /dev/video*`"), "{error}");
    }

    #[test]
    fn kernel_stamps_become_times_since_the_epoch() {
        let clocks = Clocks { epoch_ns: 1_700_000_000_000_000_000, monotonic_ns: 5_000_000_000 };
        assert_eq!(clocks.epoch_of_monotonic(4_991_000_000), 1_699_999_999_991_000_000);
        assert_eq!(clocks.epoch_of_monotonic(0), clocks.epoch_ns, "no stamp");
        assert_eq!(clocks.epoch_of_monotonic(9_000_000_000), clocks.epoch_ns, "from the future");
        let now = Clocks::read();
        assert!(1_600_000_000_000_000_000 < now.epoch_ns && 0 < now.monotonic_ns);
    }
}
