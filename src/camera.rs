//! Camera: from an image to the positions of the pieces.
//!
//! | step | module |
//! |---|---|
//! | frames of a camera, a folder or a recording | [`FrameSource`] |
//! | lens, board pose, parallax of the pieces' heights | [`CameraModel`] |
//! | colours of the pieces | [`ColorFit`] fits, [`ColorModel`] keeps |
//! | positions with covariances | [`Detector`] |
//! | motion of the camera since its calibration | [`PoseCheck`] |
//!
//! All positions are in the board frame of [`crate::board`] (m); pixels are column and row, with integer
//! coordinates at the centre of a pixel.

pub mod calibrate;
mod color;
mod detector;
mod document;
mod edges;
mod feed;
mod frame;
mod lens;
mod model;
mod pose;
mod pose_check;
mod pose_watch;
mod record;
mod shot;
mod source;
mod tune;
mod tune_page;

pub use color::{ColorCount, ColorError, ColorModel, Kind};
pub use detector::{
    BISCUITS, Detection, Detections, Detector, DetectorDocument, DetectorError, Exposure, Light,
    Pieces, Prediction, Predictions,
};
pub use document::{BoardFit, CameraDocument, CameraDocumentError, LensFit, MeasuredPoint};
pub use feed::{DetectingCamera, DetectingFrames, FeedError, FrameWarning, Seen, write_datagram};
pub use frame::{CutOff, Frame, PixelFormat, View, rgb_of_yuv, yuv_of_rgb};
pub use lens::{Distortion, Lens};
pub use model::CameraModel;
pub use pose::Pose;
pub use pose_check::{PoseCheck, PoseFeatures, PoseShift};
pub use pose_watch::{PoseChecks, PoseWarning};
pub use record::{FrameImageError, FrameImages};
pub use shot::Shot;
pub use source::{
    AviVideo, DecodeError, FrameSource, ImageFolder, McapImages, Next, SourceError, SourceSpec,
    SourceSpecError, decode_image, encode_jpeg,
};
#[cfg(target_os = "linux")]
pub use source::{V4l2Config, V4l2Source};
pub use tune::{ColorFit, Mark, TuneError};
pub use tune_page::{CheckedMark, FoundMarks, ImageResult, TunedImage, tune_page};
