use super::{PictureFile, STEP, checked_size};
use crate::Texels;
use png::{BitDepth, ColorType, Transformations};
use std::io::Cursor;

/// Deflate makes at most 1032 bytes of one, and a pixel of one bit becomes four bytes.
const MOST_BYTES: usize = 1032 * 32;

/// A PNG of any kind, but for one colour of 16 bits that stands for nothing.
pub fn decode(file: &[u8]) -> Result<PictureFile, String> {
    let mut decoder = png::Decoder::new(Cursor::new(file));
    decoder.set_transformations(Transformations::EXPAND | Transformations::ALPHA);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let info = reader.info();
    let is_deep = info.bit_depth == BitDepth::Sixteen;
    if is_deep && info.trns.is_some() {
        return Err("a transparent colour of 16 bits is not read".into());
    }
    let size = checked_size(info.width as usize, info.height as usize, 4, file.len(), MOST_BYTES)?;
    let bytes = reader.output_buffer_size().ok_or("it has too many pixels")?;
    let mut bytes = vec![0; bytes];
    let info = reader.next_frame(&mut bytes).map_err(|error| error.to_string())?;
    let bytes = &bytes[..info.buffer_size()];
    let is_gray = info.color_type == ColorType::GrayscaleAlpha;
    Ok(match (is_deep, is_gray) {
        (false, true) => PictureFile::from_rows(size, bytes, |[v, a]| [v, v, v, a], Texels::Byte),
        (false, false) => PictureFile::from_rows(size, bytes, |pixel| pixel, Texels::Byte),
        (true, true) => PictureFile::from_rows(size, &floats(bytes), |[v, a]| [v, v, v, a], Texels::Float),
        (true, false) => PictureFile::from_rows(size, &floats(bytes), |pixel| pixel, Texels::Float),
    })
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    let (values, _) = bytes.as_chunks();
    values.iter().map(|&value| f32::from(u16::from_be_bytes(value)) * STEP).collect()
}
