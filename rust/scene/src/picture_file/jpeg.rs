use super::{PictureFile, checked_size};
use crate::Texels;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// A block of 64 pixels can be the single bit that says "as before", twice for luck.
const MOST_PIXELS: usize = 1024;

/// A JPEG of one or three channels.
pub fn decode(file: &[u8]) -> Result<PictureFile, String> {
    let options = DecoderOptions::default().set_max_width(1 << 15).set_max_height(1 << 15);
    let options = options.jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), options);
    decoder.decode_headers().map_err(|error| error.to_string())?;
    let (width, height) = decoder.dimensions().ok_or("it has no pixels")?;
    let size = checked_size(width, height, 1, file.len(), MOST_PIXELS)?;
    let channels = decoder.input_colorspace();
    if !matches!(channels, Some(ColorSpace::YCbCr | ColorSpace::Luma | ColorSpace::RGB)) {
        return Err(format!("channels {channels:?} are not read"));
    }
    let bytes = decoder.decode().map_err(|error| error.to_string())?;
    Ok(PictureFile::from_rows(size, &bytes, |[r, g, b]| [r, g, b, 255], Texels::Byte))
}
