//! Lenses of other software: `camera_info` YAML of ROS and OpenCV's FileStorage YAML, and the npz of the KlaskTron
//! stack.

use crate::camera::lens::{Distortion, Lens};
use std::{collections::BTreeMap, io};

/// Error of a file of another program.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A field that is absent or has another number of values.
    #[error(
        "{field} has {found} numbers, needed are {expected}; give a calibration with plumb_bob distortion"
    )]
    Field {
        /// Name of the field.
        field: &'static str,
        /// Numbers found.
        found: usize,
        /// Numbers needed.
        expected: &'static str,
    },
    /// A distortion model that is not supported.
    #[error("the distortion model is {found}; supported is plumb_bob (k1, k2, p1, p2, k3)")]
    Model {
        /// Name of the model.
        found: String,
    },
    /// An npz file that cannot be read.
    #[error("cannot read the npz file ({0}); it must hold the arrays mtx (3 x 3) and dist")]
    Npz(String),
}

/// Read image size and lens of a `camera_info` file of ROS, or of OpenCV's FileStorage. The size is absent in some
/// files of OpenCV.
///
/// # Errors
/// When a matrix is absent or the distortion model is another one.
pub fn lens_from_yaml(text: &str) -> Result<(Option<[usize; 2]>, Lens), ImportError> {
    let fields = read_fields(text);
    let numbers = |names: &[&str]| -> Vec<f64> {
        let found = names.iter().find_map(|name| fields.get(*name));
        let list = found.map(String::as_str).unwrap_or_default();
        let list =
            list.trim_matches(|letter: char| "[]".contains(letter) || letter.is_whitespace());
        list.split(',').filter_map(|own| own.trim().parse().ok()).collect()
    };
    if let Some(model) = fields.get("distortion_model")
        && model != "plumb_bob"
    {
        return Err(ImportError::Model { found: model.clone() });
    }
    let matrix = numbers(&["camera_matrix.data", "Camera_Matrix.data", "cameraMatrix.data", "K"]);
    let distortion = numbers(&[
        "distortion_coefficients.data",
        "Distortion_Coefficients.data",
        "distCoeffs.data",
        "D",
    ]);
    let side = |names: &[&str]| numbers(names).first().map(|own| *own as usize);
    let size = side(&["image_width", "image_Width"]).zip(side(&["image_height", "image_Height"]));
    Ok((size.map(|(width, height)| [width, height]), lens_of(&matrix, &distortion)?))
}

fn lens_of(matrix: &[f64], distortion: &[f64]) -> Result<Lens, ImportError> {
    let &[fx, _, cx, _, fy, cy, ..] = matrix else {
        return Err(ImportError::Field {
            field: "the camera matrix",
            found: matrix.len(),
            expected: "9",
        });
    };
    let &[k1, k2, p1, p2, ref rest @ ..] = distortion else {
        return Err(ImportError::Field {
            field: "the list of distortion coefficients",
            found: distortion.len(),
            expected: "4 or 5",
        });
    };
    if rest.iter().skip(1).any(|own| *own != 0.0) {
        return Err(ImportError::Model {
            found: format!("one of {} coefficients", distortion.len()),
        });
    }
    let k3 = rest.first().copied().unwrap_or(0.0);
    Ok(Lens {
        focal_px: [fx, fy],
        principal_point_px: [cx, cy],
        distortion: Distortion { k1, k2, p1, p2, k3 },
    })
}

/// Values by `key` or `key.subkey`, of the two levels that these files have; lists may span lines.
fn read_fields(text: &str) -> BTreeMap<String, String> {
    let mut fields = BTreeMap::new();
    let mut parent = String::new();
    let mut open: Option<(String, String)> = None;
    for line in text.lines() {
        if let Some((key, mut value)) = open.take() {
            value.push_str(line.trim());
            if value.contains(']') {
                fields.insert(key, value);
            } else {
                open = Some((key, value));
            }
            continue;
        }
        let Some((key, value)) = line.split_once(':') else { continue };
        let (name, value) = (key.trim(), value.trim());
        let key =
            if key.starts_with([' ', '\t']) { format!("{parent}.{name}") } else { name.to_owned() };
        if !key.contains('.') {
            name.clone_into(&mut parent);
        }
        if value.starts_with('[') && !value.contains(']') {
            open = Some((key, value.to_owned()));
        } else {
            fields.insert(key, value.to_owned());
        }
    }
    fields
}

/// Read the lens of `calibration_data.npz`, as the KlaskTron stack writes it (`mtx`, `dist`).
///
/// # Errors
/// When the file is no npz or lacks an array.
pub fn lens_from_npz(source: impl io::Read + io::Seek) -> Result<Lens, ImportError> {
    let wrong = |error: ndarray_npy::ReadNpzError| ImportError::Npz(error.to_string());
    let mut npz = ndarray_npy::NpzReader::new(source).map_err(wrong)?;
    let mut numbers = |name: &str| -> Result<Vec<f64>, ImportError> {
        let array: ndarray::ArrayD<f64> = npz.by_name(name).map_err(wrong)?;
        Ok(array.iter().copied().collect())
    };
    let (matrix, distortion) = (numbers("mtx")?, numbers("dist")?);
    lens_of(&matrix, &distortion)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROS: &str = "image_width: 1280\nimage_height: 720\ncamera_name: overhead\ncamera_matrix:\n  rows: 3\n  \
                       cols: 3\n  data: [1150.5, 0.0, 648.3, 0.0, 1149.0, 352.7,\n         0.0, 0.0, 1.0]\n\
                       distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  \
                       data: [-0.118, 0.062, 0.0007, -0.0004, 0.0]\n";

    #[test]
    fn camera_info_of_ros_is_read() {
        let (size, lens) = lens_from_yaml(ROS).unwrap();
        assert_eq!(size, Some([1280, 720]));
        assert_eq!(lens.focal_px, [1150.5, 1149.0]);
        assert_eq!(lens.principal_point_px, [648.3, 352.7]);
        assert_eq!(
            lens.distortion,
            Distortion { k1: -0.118, k2: 0.062, p1: 0.0007, p2: -0.0004, k3: 0.0 }
        );
    }

    #[test]
    fn file_storage_of_opencv_is_read() {
        let text = "%YAML:1.0\n---\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1150., \
                    0., 640., 0., 1150., 360., 0.,\n       0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: \
                    1\n   cols: 5\n   dt: d\n   data: [ -1.1e-01, 6.2e-02, 0., 0., 0. ]\n";
        let (size, lens) = lens_from_yaml(text).unwrap();
        assert_eq!((size, lens.focal_px[1], lens.distortion.k1), (None, 1150.0, -0.11));
    }

    #[test]
    fn other_models_and_missing_matrices_are_refused() {
        let error =
            lens_from_yaml(&ROS.replace("plumb_bob", "equidistant")).unwrap_err().to_string();
        assert!(error.starts_with("the distortion model is equidistant;"), "{error}");
        let error = lens_from_yaml("image_width: 3\n").unwrap_err().to_string();
        assert!(error.starts_with("the camera matrix has 0 numbers, needed are 9;"), "{error}");
    }
}
