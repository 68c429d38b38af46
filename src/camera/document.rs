//! Calibration file `camera.json`: lens and board pose, with the errors of their fit.

use super::{
    lens::{Distortion, Lens},
    model::CameraModel,
    pose::Pose,
};
use serde::{Deserialize, Serialize};

/// Version of the file.
const SCHEMA_VERSION: u32 = 1;
/// Largest side of an image (pixels).
const MAX_SIDE_PX: usize = 16_384;
/// Range of the camera's height above the field (m).
const HEIGHT_RANGE: [f64; 2] = [0.05, 10.0];

/// Contents of `camera.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraDocument {
    /// Version of the format; 1.
    #[serde(default = "schema_version")]
    pub schema_version: u32,
    /// Columns of the images that the calibration is for.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Focal lengths along columns and rows (pixels).
    pub focal_px: [f64; 2],
    /// Principal point: column and row (pixels).
    pub principal_point_px: [f64; 2],
    /// Distortion coefficients, in OpenCV's order.
    pub distortion: Distortion,
    /// Rotation vector of camera_from_board (axis times angle, rad); absent without a board pose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation_rad: Option<[f64; 3]>,
    /// Translation of camera_from_board (m); absent without a board pose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub translation_m: Option<[f64; 3]>,
    /// Errors of the lens' fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lens_fit: Option<LensFit>,
    /// Errors of the board pose's fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub board_fit: Option<BoardFit>,
    /// Points of the table that the board pose was fitted to. A check compares the tags among them with later images.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub board_points: Vec<MeasuredPoint>,
}

/// Known point of the table with its pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredPoint {
    /// Id of an AprilTag; absent for a point that a person has marked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tag: Option<u32>,
    /// Place in the board frame (m).
    pub place_m: [f64; 3],
    /// Measured column and row (pixels).
    pub pixel_px: [f64; 2],
}

fn schema_version() -> u32 {
    SCHEMA_VERSION
}

/// Errors of the fit of a lens.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LensFit {
    /// Images with a complete board.
    pub images: usize,
    /// Corners.
    pub corners: usize,
    /// Root mean square of the distance between measured and projected corners (pixels).
    pub reprojection_rms_px: f64,
    /// Half widths of the 95 % intervals of focal lengths, principal point (pixels) and k1, k2, p1, p2, k3.
    pub ci95_half_width: [f64; 9],
}

/// Errors of the fit of a board pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BoardFit {
    /// Points.
    pub points: usize,
    /// Root mean square of the distance between measured and projected points (pixels).
    pub reprojection_rms_px: f64,
    /// Largest half width of the 95 % interval of a position on the field (m), from the pose alone.
    pub ci95_half_width_m: f64,
}

/// Error: a calibration that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CameraDocumentError {
    /// The text is not JSON of this form.
    #[error("invalid camera calibration: {0}; write one with `klasktron calibrate-camera`")]
    Syntax(#[from] serde_json::Error),
    /// A newer version.
    #[error("schema_version is {found}; this program reads version {SCHEMA_VERSION}")]
    Version {
        /// Version found.
        found: u32,
    },
    /// A value outside its range.
    #[error("{name} is {value}; it must lie in [{low}, {high}]")]
    OutOfRange {
        /// Field, with its unit.
        name: &'static str,
        /// Value found.
        value: f64,
        /// Lower limit.
        low: f64,
        /// Upper limit.
        high: f64,
    },
    /// No pose of the board.
    #[error(
        "the calibration has a lens but no pose of the board (rotation_rad, translation_m); add it with \
         `klasktron calibrate-camera --board`"
    )]
    NoBoard,
    /// Images of another size.
    #[error(
        "the calibration is for {expected_width_px} x {expected_height_px} pixels, but the images have {width_px} x \
         {height_px}; calibrate at this resolution, or set the camera to that of the calibration"
    )]
    Resolution {
        /// Columns of the calibration.
        expected_width_px: usize,
        /// Rows of the calibration.
        expected_height_px: usize,
        /// Columns of the image.
        width_px: usize,
        /// Rows of the image.
        height_px: usize,
    },
}

impl CameraDocument {
    /// Create the document of a lens and, if known, a board pose.
    #[must_use]
    pub fn new(
        [width_px, height_px]: [usize; 2],
        lens: &Lens,
        camera_from_board: Option<&Pose>,
    ) -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            width_px,
            height_px,
            focal_px: lens.focal_px,
            principal_point_px: lens.principal_point_px,
            distortion: lens.distortion,
            rotation_rad: camera_from_board.map(Pose::rotation_vector),
            translation_m: camera_from_board.map(|pose| pose.translation),
            lens_fit: None,
            board_fit: None,
            board_points: Vec::new(),
        }
    }

    /// Parse and check a file.
    ///
    /// ```
    /// use klasktron::camera::CameraDocument;
    /// let text = r#"{"width_px": 1280, "height_px": 720, "focal_px": [1150, -3], "principal_point_px": [640, 360],
    ///     "distortion": {"k1": 0, "k2": 0, "p1": 0, "p2": 0}}"#;
    /// assert_eq!(
    ///     CameraDocument::from_json(text).unwrap_err().to_string(),
    ///     "focal_px is -3; it must lie in [1, 100000]"
    /// );
    /// ```
    ///
    /// # Errors
    /// When the text is not JSON of this form or has a value outside its range.
    pub fn from_json(text: &str) -> Result<Self, CameraDocumentError> {
        let document: Self = serde_json::from_str(text)?;
        document.check()?;
        Ok(document)
    }

    pub(super) fn check(&self) -> Result<(), CameraDocumentError> {
        if self.schema_version != SCHEMA_VERSION {
            return Err(CameraDocumentError::Version { found: self.schema_version });
        }
        let within = |name, value: f64, low: f64, high: f64| {
            if low <= value && value <= high {
                Ok(())
            } else {
                Err(CameraDocumentError::OutOfRange { name, value, low, high })
            }
        };
        for (name, side) in [("width_px", self.width_px), ("height_px", self.height_px)] {
            within(name, side as f64, 16.0, MAX_SIDE_PX as f64)?;
        }
        for focal in self.focal_px {
            within("focal_px", focal, 1.0, 1e5)?;
        }
        for (at, side) in self.principal_point_px.iter().zip([self.width_px, self.height_px]) {
            within("principal_point_px", *at, 0.0, side as f64)?;
        }
        let d = &self.distortion;
        for (name, value, limit) in [
            ("k1", d.k1, 5.0),
            ("k2", d.k2, 50.0),
            ("p1", d.p1, 0.5),
            ("p2", d.p2, 0.5),
            ("k3", d.k3, 500.0),
        ] {
            within(name, value, -limit, limit)?;
        }
        if let Some(pose) = self.pose() {
            let height = pose.inverse().translation[2];
            within(
                "the camera's height above the field (m)",
                height,
                HEIGHT_RANGE[0],
                HEIGHT_RANGE[1],
            )?;
        }
        Ok(())
    }

    /// Return the lens.
    #[must_use]
    pub fn lens(&self) -> Lens {
        Lens {
            focal_px: self.focal_px,
            principal_point_px: self.principal_point_px,
            distortion: self.distortion,
        }
    }

    /// Return the pose of the board, if known.
    #[must_use]
    pub fn pose(&self) -> Option<Pose> {
        Some(Pose::from_vectors(self.rotation_rad?, self.translation_m?))
    }

    /// Return the camera.
    ///
    /// # Errors
    /// When there is no pose of the board.
    pub fn camera(&self) -> Result<CameraModel, CameraDocumentError> {
        let camera_from_board = self.pose().ok_or(CameraDocumentError::NoBoard)?;
        Ok(CameraModel {
            width_px: self.width_px,
            height_px: self.height_px,
            lens: self.lens(),
            camera_from_board,
        })
    }
}

impl CameraModel {
    /// Check that images of `size` (columns, rows) belong to this calibration.
    ///
    /// # Errors
    /// When the size differs.
    pub fn check_size(&self, [width_px, height_px]: [usize; 2]) -> Result<(), CameraDocumentError> {
        if [width_px, height_px] == [self.width_px, self.height_px] {
            return Ok(());
        }
        Err(CameraDocumentError::Resolution {
            expected_width_px: self.width_px,
            expected_height_px: self.height_px,
            width_px,
            height_px,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::model::tests::tilted;

    #[test]
    fn a_camera_survives_its_file() {
        let camera = tilted();
        let size = [camera.width_px, camera.height_px];
        let document = CameraDocument::new(size, &camera.lens, Some(&camera.camera_from_board));
        let text = serde_json::to_string(&document).unwrap();
        let back = CameraDocument::from_json(&text).unwrap().camera().unwrap();
        let point = [0.1, -0.2, 0.01];
        let [a, b] = [camera, back].map(|camera| camera.project(point).unwrap());
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 1e-9);
    }

    #[test]
    fn a_lens_without_a_board_and_another_resolution_are_refused() {
        let camera = tilted();
        let document = CameraDocument::new([1280, 720], &camera.lens, None);
        assert!(matches!(document.camera(), Err(CameraDocumentError::NoBoard)));
        let error = camera.check_size([640, 480]).unwrap_err().to_string();
        assert!(error.starts_with(
            "the calibration is for 1280 x 720 pixels, but the images have 640 x 480;"
        ));
    }
}
