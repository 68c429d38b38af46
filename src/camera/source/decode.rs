//! PNG and JPEG to frames, and frames to JPEG.

use crate::camera::frame::{CutOff, Frame, yuv_of_rgb};
use std::io::Cursor;
use zune_jpeg::{
    JpegDecoder,
    zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions},
};

/// Largest side of an image (pixels): a wrong header must not take all memory.
const MAX_SIDE_PX: usize = 16_384;

/// Error of an image.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// Neither PNG nor JPEG.
    #[error("it begins with {begins}, which is neither PNG nor JPEG")]
    Unknown {
        /// First bytes, hexadecimal.
        begins: String,
    },
    /// Error of the JPEG decoder.
    #[error("the JPEG decoder stops: {0}")]
    Jpeg(String),
    /// Error of the PNG decoder.
    #[error("the PNG decoder stops: {0}")]
    Png(#[from] png::DecodingError),
    /// A kind of pixels that is not supported.
    #[error("its pixels are {found}; supported are grey, RGB and RGBA of 8 bits")]
    Pixels {
        /// Kind of pixels.
        found: String,
    },
    /// A size that is not supported.
    #[error(
        "it has {width_px} x {height_px} pixels; supported are an even width and at most {MAX_SIDE_PX} a side"
    )]
    Size {
        /// Columns.
        width_px: usize,
        /// Rows.
        height_px: usize,
    },
    /// Fewer pixels than the header says.
    #[error(transparent)]
    CutOff(#[from] CutOff),
}

/// Memory of the decoders, reused from image to image.
#[derive(Debug, Default, Clone)]
pub(super) struct Scratch {
    pixels: Vec<u8>,
    /// JPEG image whose Huffman tables were completed.
    completed: Vec<u8>,
}

/// Decode a PNG or JPEG file into a frame.
///
/// # Errors
/// When the bytes are neither, or are damaged.
pub fn decode_image(bytes: &[u8], frame: &mut Frame) -> Result<(), DecodeError> {
    decode_with(bytes, frame, &mut Scratch::default())
}

pub(super) fn decode_with(
    bytes: &[u8],
    frame: &mut Frame,
    scratch: &mut Scratch,
) -> Result<(), DecodeError> {
    match bytes {
        [0xff, 0xd8, ..] => decode_jpeg(bytes, frame, scratch),
        [0x89, b'P', b'N', b'G', ..] => decode_png(bytes, frame, scratch),
        _ => {
            let begins = bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
            Err(DecodeError::Unknown { begins })
        }
    }
}

fn check_size(width_px: usize, height_px: usize) -> Result<[usize; 2], DecodeError> {
    let fits = |side: usize| 0 < side && side <= MAX_SIDE_PX;
    if fits(width_px) && fits(height_px) && width_px.is_multiple_of(2) {
        Ok([width_px, height_px])
    } else {
        Err(DecodeError::Size { width_px, height_px })
    }
}

/// Image that says that it has the standard Huffman tables where `image` has none: cameras and MJPEG files may leave
/// them out. `room` holds the changed copy.
fn with_huffman_tables<'a>(image: &'a [u8], room: &'a mut Vec<u8>) -> &'a [u8] {
    /// Segment after the start of the image by which the decoder uses the standard tables.
    const STANDARD: [u8; 18] = *b"\xff\xe0\0\x10AVI1\0\0\0\0\0\0\0\0\0\0";
    const START: usize = 2;
    const TABLES: u8 = 0xc4;
    const SCAN: u8 = 0xda;
    let find = |bytes: &[u8], marker: u8| bytes.windows(2).position(|own| own == [0xff, marker]);
    let lacks_tables = find(image, SCAN).is_some_and(|scan| find(&image[..scan], TABLES).is_none());
    if !lacks_tables {
        return image;
    }
    room.clear();
    let (start, rest) = image.split_at(START);
    [start, &STANDARD, rest].iter().for_each(|part| room.extend_from_slice(part));
    room
}

fn decode_jpeg(image: &[u8], frame: &mut Frame, scratch: &mut Scratch) -> Result<(), DecodeError> {
    let Scratch { pixels, completed } = scratch;
    let bytes = with_huffman_tables(image, completed);
    // A cut-off image must be an error: grey rows would look like a table without pieces.
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(MAX_SIDE_PX)
        .set_max_height(MAX_SIDE_PX)
        .jpeg_set_out_colorspace(ColorSpace::YCbCr);
    let wrong = |error: zune_jpeg::errors::DecodeErrors| DecodeError::Jpeg(error.to_string());
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(wrong)?;
    let (width, height) = decoder.dimensions().unwrap_or((0, 0));
    let size = check_size(width, height)?;
    if decoder.input_colorspace() == Some(ColorSpace::Luma) {
        let options = options.jpeg_set_out_colorspace(ColorSpace::Luma);
        decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        decoder.decode_headers().map_err(wrong)?;
        pixels.resize(width * height, 0);
        decoder.decode_into(pixels).map_err(wrong)?;
        return Ok(frame.set_grey(size, pixels)?);
    }
    pixels.resize(width * height * 3, 0);
    decoder.decode_into(pixels).map_err(wrong)?;
    Ok(frame.set_triples(size, pixels, |yuv| yuv)?)
}

fn decode_png(bytes: &[u8], frame: &mut Frame, scratch: &mut Scratch) -> Result<(), DecodeError> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info()?;
    let info = reader.info();
    let size = check_size(info.width as usize, info.height as usize)?;
    let (color, _) = reader.output_color_type();
    let bytes = size[0] * size[1] * color.samples();
    scratch.pixels.resize(bytes, 0);
    reader.next_frame(&mut scratch.pixels)?;
    match color {
        png::ColorType::Grayscale => frame.set_grey(size, &scratch.pixels)?,
        png::ColorType::Rgb => frame.set_triples(size, &scratch.pixels, yuv_of_rgb)?,
        png::ColorType::Rgba => {
            let opaque = size[0] * size[1] * 3;
            for at in 0..size[0] * size[1] {
                scratch.pixels.copy_within(4 * at..4 * at + 3, 3 * at);
            }
            frame.set_triples(size, &scratch.pixels[..opaque], yuv_of_rgb)?;
        }
        other => return Err(DecodeError::Pixels { found: format!("{other:?}") }),
    }
    Ok(())
}

/// Encode a frame as JPEG with `quality` 1 to 100, appended to `bytes`.
///
/// # Errors
/// When the frame is empty or larger than a JPEG can be (65535 pixels a side).
pub fn encode_jpeg(frame: &Frame, quality: u8, bytes: &mut Vec<u8>) -> Result<(), String> {
    let side = |pixels: usize| {
        u16::try_from(pixels).map_err(|_too_large| format!("{pixels} pixels a side"))
    };
    let (width, height) = (side(frame.width_px())?, side(frame.height_px())?);
    let view = frame.view();
    let mut pixels = Vec::with_capacity(frame.width_px() * frame.height_px() * 3);
    for row in 0..frame.height_px() {
        pixels.extend((0..frame.width_px()).flat_map(|column| view.yuv(column, row)));
    }
    let mut encoder = jpeg_encoder::Encoder::new(bytes, quality.clamp(1, 100));
    encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_2_1);
    encoder
        .encode(&pixels, width, height, jpeg_encoder::ColorType::Ycbcr)
        .map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Smooth picture: JPEG keeps it within a few levels.
    fn smooth() -> Frame {
        let mut frame = Frame::default();
        let bytes: Vec<u8> = (0..24)
            .flat_map(|row| {
                (0..32).flat_map(move |column| [40 + 5 * column, 20 + 6 * row, 200 - 4 * column])
            })
            .collect();
        frame.set_triples([32, 24], &bytes, yuv_of_rgb).unwrap();
        frame
    }

    fn largest_difference(a: &Frame, b: &Frame) -> u8 {
        a.bytes().iter().zip(b.bytes()).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
    }

    #[test]
    fn a_frame_survives_jpeg() {
        let frame = smooth();
        let mut bytes = Vec::new();
        encode_jpeg(&frame, 95, &mut bytes).unwrap();
        let mut back = Frame::default();
        decode_image(&bytes, &mut back).unwrap();
        assert!(largest_difference(&frame, &back) < 6);
        assert!(
            decode_image(&bytes[..bytes.len() / 2], &mut back).is_err(),
            "half a file is refused"
        );
    }

    #[test]
    fn png_of_every_kind_is_read() {
        let frame = smooth();
        for (color, samples) in
            [(png::ColorType::Rgb, 3), (png::ColorType::Rgba, 4), (png::ColorType::Grayscale, 1)]
        {
            let mut bytes = Vec::new();
            let mut encoder = png::Encoder::new(&mut bytes, 32, 24);
            encoder.set_color(color);
            encoder.set_depth(png::BitDepth::Eight);
            let rgb = frame.to_rgb();
            let data: Vec<u8> = rgb
                .chunks_exact(3)
                .flat_map(|rgb| [rgb[0], rgb[1], rgb[2], 255].into_iter().take(samples))
                .collect();
            encoder.write_header().unwrap().write_image_data(&data).unwrap();
            let mut back = Frame::default();
            decode_image(&bytes, &mut back).unwrap();
            assert_eq!([back.width_px(), back.height_px()], [32, 24]);
            if samples != 1 {
                assert!(largest_difference(&frame, &back) < 4);
            }
            assert!(decode_image(&bytes[..60], &mut back).is_err());
        }
    }

    #[test]
    fn other_files_are_refused_with_their_first_bytes() {
        let error = decode_image(b"GIF89a", &mut Frame::default()).unwrap_err();
        assert_eq!(error.to_string(), "it begins with 47494638, which is neither PNG nor JPEG");
    }
}
