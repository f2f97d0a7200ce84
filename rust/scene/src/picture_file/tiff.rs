use super::{PictureFile, STEP, checked_size};
use crate::Texels;
use std::io::Cursor;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::{CompressionMethod, PhotometricInterpretation, Tag};
use tiff::{ColorType, TiffError};

/// LZW makes at most 4096 bytes of a code of 9 bits or more; deflate and runs make less.
const MOST_BYTES: usize = 4096;
/// Values of tags that are read; those that have a default may be left out.
const READ: [(Tag, &[u16]); 5] = [
    (Tag::Orientation, &[1]),
    (Tag::ExtraSamples, &[1, 2]), // Alpha, not something unnamed.
    (Tag::PlanarConfiguration, &[1]),
    (
        Tag::Compression,
        &[
            CompressionMethod::None.to_u16(),
            CompressionMethod::LZW.to_u16(),
            CompressionMethod::Deflate.to_u16(),
            CompressionMethod::OldDeflate.to_u16(),
            CompressionMethod::PackBits.to_u16(),
        ],
    ),
    (
        Tag::PhotometricInterpretation,
        &[PhotometricInterpretation::BlackIsZero.to_u16(), PhotometricInterpretation::RGB.to_u16()],
    ),
];

/// The first page of a TIFF: grey, or red, green, blue and perhaps alpha, of 8 or 16 bits or floats; the first row on top,
/// channels of a pixel together.
pub fn decode(file: &[u8]) -> Result<PictureFile, String> {
    let words = |error: TiffError| error.to_string();
    let mut decoder = Decoder::new(Cursor::new(file)).map_err(words)?;
    for (tag, read) in READ {
        let value = decoder.find_tag_unsigned(tag).map_err(words)?;
        if let Some(value) = value.filter(|value| !read.contains(value)) {
            return Err(format!("{tag:?} {value} is not read"));
        }
    }
    let (channels, bits) = match decoder.colortype().map_err(words)? {
        ColorType::Gray(bits @ (8 | 16 | 32)) => (1, bits),
        ColorType::RGB(bits @ (8 | 16 | 32)) => (3, bits),
        ColorType::RGBA(bits @ (8 | 16 | 32)) => (4, bits),
        other => return Err(format!("{other:?} is not read")),
    };
    let bytes = channels * usize::from(bits) / 8;
    let (width, height) = decoder.dimensions().map_err(words)?;
    let size = checked_size(width as usize, height as usize, bytes, file.len(), MOST_BYTES)?;
    let (chunk_width, _) = decoder.chunk_dimensions();
    checked_size(chunk_width as usize, 1, bytes, file.len(), MOST_BYTES)?;
    // Its own limits, 256 MiB, are right for tags; those of pixels are known by now.
    let mut limits = Limits::default();
    limits.decoding_buffer_size = size[0] * size[1] * bytes;
    limits.intermediate_buffer_size = file.len();
    match decoder.with_limits(limits).read_image().map_err(words)? {
        DecodingResult::U8(values) => picture(size, channels, &values, u8::MAX, Texels::Byte),
        DecodingResult::U16(values) => {
            let floats: Vec<_> = values.into_iter().map(|value| f32::from(value) * STEP).collect();
            picture(size, channels, &floats, 1.0, Texels::Float)
        }
        DecodingResult::F32(values) => picture(size, channels, &values, 1.0, Texels::Float),
        _ => Err("its kind of numbers is not read".into()),
    }
}

fn picture<T: Copy>(
    size: [usize; 2],
    channels: usize,
    values: &[T],
    one: T,
    texels: fn(Vec<T>) -> Texels,
) -> Result<PictureFile, String> {
    if values.len() != size[0] * size[1] * channels {
        return Err("its channels are not those that it says".into());
    }
    Ok(match channels {
        1 => PictureFile::from_rows(size, values, |[v]| [v, v, v, one], texels),
        3 => PictureFile::from_rows(size, values, |[r, g, b]| [r, g, b, one], texels),
        _ => PictureFile::from_rows(size, values, |pixel| pixel, texels),
    })
}
