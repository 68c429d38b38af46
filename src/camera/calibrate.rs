//! Calibration: lens from images of a checkerboard, board pose from AprilTags or marked corners.
//!
//! 1. [`find_checkerboard`] finds the inner corners of the board in an image, to a fraction of a pixel.
//!    [`find_charuco`] finds those of a ChArUco board, of which a part may be hidden.
//! 2. [`calibrate_lens`] fits focal lengths, principal point, distortion and the pose of each image by least squares
//!    of the reprojection errors (Zhang, "A flexible new technique for camera calibration", IEEE TPAMI 22, 2000).
//! 3. [`find_tags`] finds AprilTags of the family 36h11; [`fit_board_pose`] fits the pose of the table from their
//!    centres, or from marked points of the field.

mod charuco;
mod checkerboard;
mod import;
mod least_squares;
mod lens_fit;
mod page;
mod tags;

pub use charuco::{CharucoBoard, Dictionary, MOST_MARKERS, find_charuco};
pub use checkerboard::{Checkerboard, find_checkerboard};
pub use import::{ImportError, lens_from_npz, lens_from_yaml};
pub(super) use least_squares::solve;
pub use lens_fit::{
    BoardView, CalibrateError, LensCalibration, RadialOrder, calibrate_lens, fit_board_pose,
};
pub use page::{LARGEST_REPROJECTION_PX, LensImages, calibration_page};
pub use tags::{Tag, find_tags};
