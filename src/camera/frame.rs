//! Frame: one image in memory, 4:2:2, with the time of its capture.
//!
//! Cameras deliver YUYV or UYVY, and the detector reads these bytes as they are. Other images (PNG, JPEG, grey) are
//! converted when they are read. Y, U and V are those of BT.601 with full range (JFIF), 0 to 255 with U and V
//! around 128, and a chroma sample lies between its two pixels.

use crate::units::Nanos;

/// Bytes of a pixel in 4:2:2.
const BYTES_PER_PIXEL: usize = 2;

/// Order of the bytes of two neighbouring pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelFormat {
    /// Y0 U Y1 V.
    Yuyv,
    /// U Y0 V Y1.
    Uyvy,
}

impl PixelFormat {
    /// Return the offsets of Y, U and V in the bytes of two pixels.
    const fn offsets(self) -> [usize; 3] {
        match self {
            Self::Yuyv => [0, 1, 3],
            Self::Uyvy => [1, 0, 2],
        }
    }
}

/// Error: a frame with too few bytes.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "the frame is cut off: {bytes} bytes for {width_px} x {height_px} pixels, which need {expected}; the frame is \
     left out (check the cable and the load of the USB bus)"
)]
pub struct CutOff {
    /// Bytes received.
    pub bytes: usize,
    /// Bytes needed.
    pub expected: usize,
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
}

/// One image. Its buffer is reused from frame to frame, so that reading allocates nothing after the start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame {
    width_px: usize,
    height_px: usize,
    format: PixelFormat,
    data: Vec<u8>,
    /// Middle of the exposure, or the best known time of capture (ns since the Unix epoch).
    pub capture_time: Nanos,
    /// Time at which this program got the frame (ns since the Unix epoch); the capture time where unknown.
    pub received_time: Nanos,
}

impl Default for Frame {
    fn default() -> Self {
        Self {
            width_px: 0,
            height_px: 0,
            format: PixelFormat::Yuyv,
            data: Vec::new(),
            capture_time: Nanos(0),
            received_time: Nanos(0),
        }
    }
}

impl Frame {
    /// Return the number of columns.
    #[must_use]
    pub fn width_px(&self) -> usize {
        self.width_px
    }

    /// Return the number of rows.
    #[must_use]
    pub fn height_px(&self) -> usize {
        self.height_px
    }

    /// Return the bytes, `2 * width * height`, row by row.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.data
    }

    /// Return the order of the bytes.
    #[must_use]
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// Copy 4:2:2 bytes as a camera delivers them; `size` is columns and rows, columns must be even.
    ///
    /// # Errors
    /// When there are fewer bytes than the size needs.
    pub fn set_packed(
        &mut self,
        size: [usize; 2],
        format: PixelFormat,
        bytes: &[u8],
    ) -> Result<(), CutOff> {
        let expected = check_bytes(size, bytes.len(), BYTES_PER_PIXEL)?;
        self.begin(size, format);
        self.data.extend_from_slice(&bytes[..expected]);
        Ok(())
    }

    /// Copy another frame with its times; the memory is reused.
    pub fn copy_from(&mut self, other: &Self) {
        self.begin([other.width_px, other.height_px], other.format);
        self.data.extend_from_slice(&other.data);
        (self.capture_time, self.received_time) = (other.capture_time, other.received_time);
    }

    /// Set from grey bytes.
    ///
    /// # Errors
    /// As [`set_packed`](Self::set_packed).
    pub fn set_grey(&mut self, size: [usize; 2], bytes: &[u8]) -> Result<(), CutOff> {
        let expected = check_bytes(size, bytes.len(), 1)?;
        self.begin(size, PixelFormat::Yuyv);
        self.data.extend(bytes[..expected].iter().flat_map(|&y| [y, 128]));
        Ok(())
    }

    /// Set from bytes of three channels, Y U V or, with `to_yuv`, any others.
    ///
    /// # Errors
    /// As [`set_packed`](Self::set_packed).
    pub fn set_triples(
        &mut self,
        size: [usize; 2],
        bytes: &[u8],
        to_yuv: impl Fn([u8; 3]) -> [u8; 3],
    ) -> Result<(), CutOff> {
        let expected = check_bytes(size, bytes.len(), 3)?;
        self.begin(size, PixelFormat::Yuyv);
        let mean = |a: u8, b: u8| (u16::from(a) + u16::from(b)).div_ceil(2) as u8;
        for pair in bytes[..expected].chunks_exact(6) {
            let first = to_yuv([pair[0], pair[1], pair[2]]);
            let second = to_yuv([pair[3], pair[4], pair[5]]);
            self.data.extend([
                first[0],
                mean(first[1], second[1]),
                second[0],
                mean(first[2], second[2]),
            ]);
        }
        Ok(())
    }

    fn begin(&mut self, size: [usize; 2], format: PixelFormat) {
        [self.width_px, self.height_px] = size;
        self.format = format;
        self.data.clear();
        self.data.reserve(size[0] * size[1] * BYTES_PER_PIXEL);
    }

    /// Return the image for reading single pixels.
    #[must_use]
    pub fn view(&self) -> View<'_> {
        let [y, u, v] = self.format.offsets();
        View {
            width_px: self.width_px,
            height_px: self.height_px,
            data: &self.data,
            offsets: [y, u, v],
        }
    }

    /// Return red, green and blue, row by row, three bytes per pixel. Allocates; for pages and files.
    #[must_use]
    pub fn to_rgb(&self) -> Vec<u8> {
        let view = self.view();
        let pixels =
            (0..self.height_px).flat_map(|row| (0..self.width_px).map(move |column| (column, row)));
        pixels.flat_map(|(column, row)| rgb_of_yuv(view.yuv(column, row))).collect()
    }
}

fn check_bytes(
    [width_px, height_px]: [usize; 2],
    bytes: usize,
    per_pixel: usize,
) -> Result<usize, CutOff> {
    let expected = width_px * height_px * per_pixel;
    if bytes < expected {
        Err(CutOff { bytes, expected, width_px, height_px })
    } else {
        Ok(expected)
    }
}

/// Pixels of a frame.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    data: &'a [u8],
    offsets: [usize; 3],
}

impl<'a> View<'a> {
    /// Return Y, U and V of a pixel; panics outside of the image.
    #[must_use]
    #[inline]
    pub fn yuv(&self, column: usize, row: usize) -> [u8; 3] {
        let pair = (row * self.width_px + (column & !1)) * BYTES_PER_PIXEL;
        let bytes = &self.data[pair..pair + 4];
        let [y, u, v] = self.offsets;
        [bytes[y + 2 * (column & 1)], bytes[u], bytes[v]]
    }

    /// Return the bytes of one row, two per pixel.
    #[must_use]
    #[inline]
    pub(super) fn row(&self, row: usize) -> &'a [u8] {
        let bytes = self.width_px * BYTES_PER_PIXEL;
        &self.data[row * bytes..(row + 1) * bytes]
    }

    /// Return the offsets of Y, U and V in the four bytes of two pixels.
    #[inline]
    pub(super) fn offsets(&self) -> [usize; 3] {
        self.offsets
    }

    /// Return Y at a place between pixels (bilinear); `None` outside of the image.
    #[must_use]
    pub fn luma_at(&self, [column, row]: [f64; 2]) -> Option<f64> {
        let limits = [self.width_px as f64 - 1.001, self.height_px as f64 - 1.001];
        if !(0.0 <= column && column < limits[0] && 0.0 <= row && row < limits[1]) {
            return None;
        }
        let (c, r) = (column as usize, row as usize);
        let (fc, fr) = (column - c as f64, row - r as f64);
        let y = |c, r| f64::from(self.yuv(c, r)[0]);
        let top = y(c, r) * (1.0 - fc) + y(c + 1, r) * fc;
        let bottom = y(c, r + 1) * (1.0 - fc) + y(c + 1, r + 1) * fc;
        Some(top * (1.0 - fr) + bottom * fr)
    }
}

fn byte(value: f64) -> u8 {
    value.round().clamp(0.0, 255.0) as u8
}

/// Return Y, U, V of red, green, blue (BT.601, full range; JFIF 1.02).
#[must_use]
pub fn yuv_of_rgb(rgb: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = rgb.map(f64::from);
    [
        byte(0.299 * r + 0.587 * g + 0.114 * b),
        byte(128.0 - 0.168_736 * r - 0.331_264 * g + 0.5 * b),
        byte(128.0 + 0.5 * r - 0.418_688 * g - 0.081_312 * b),
    ]
}

/// Return red, green, blue of Y, U, V (BT.601, full range; JFIF 1.02).
#[must_use]
pub fn rgb_of_yuv(yuv: [u8; 3]) -> [u8; 3] {
    linear_rgb(yuv.map(f64::from)).map(byte)
}

/// Return red, green, blue of Y, U, V without rounding; values may lie outside of 0 to 255.
pub(super) fn linear_rgb([y, u, v]: [f64; 3]) -> [f64; 3] {
    let (u, v) = (u - 128.0, v - 128.0);
    [y + 1.402 * v, y - 0.344_136 * u - 0.714_136 * v, y + 1.772 * u]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_orders_give_the_same_pixels() {
        let mut yuyv = Frame::default();
        let mut uyvy = Frame::default();
        yuyv.set_packed([2, 1], PixelFormat::Yuyv, &[10, 20, 30, 40]).unwrap();
        uyvy.set_packed([2, 1], PixelFormat::Uyvy, &[20, 10, 40, 30]).unwrap();
        for column in 0..2 {
            assert_eq!(yuyv.view().yuv(column, 0), [[10, 20, 40], [30, 20, 40]][column]);
            assert_eq!(uyvy.view().yuv(column, 0), yuyv.view().yuv(column, 0));
        }
    }

    #[test]
    fn colours_survive_the_conversion() {
        for rgb in [[0, 0, 0], [255, 255, 255], [237, 158, 25], [30, 60, 120], [204, 148, 117]] {
            let back = rgb_of_yuv(yuv_of_rgb(rgb));
            let error = (0..3).map(|k| rgb[k].abs_diff(back[k])).max().unwrap();
            assert!(error <= 2, "{rgb:?} {back:?}");
        }
        assert_eq!(yuv_of_rgb([255, 0, 0]), [76, 85, 255]);
    }

    #[test]
    fn a_frame_that_is_cut_off_is_refused_with_its_size() {
        let error = Frame::default().set_packed([4, 2], PixelFormat::Yuyv, &[0; 15]).unwrap_err();
        assert!(
            error
                .to_string()
                .starts_with("the frame is cut off: 15 bytes for 4 x 2 pixels, which need 16;")
        );
    }
}
