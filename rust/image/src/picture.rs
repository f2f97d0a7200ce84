//! Display pictures: PNG out through a view transform, PNG or EXR in as scene-linear colour.

use crate::{Image, ImageError, ViewTransform, linear_from_srgb, read_exr, write_atomically};
use std::fs::File;
use std::io::{self, BufWriter, Cursor};
use std::path::Path;

/// Bits for each value of a PNG.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BitDepth {
    /// 8 bits.
    #[default]
    Eight,
    /// 16 bits.
    Sixteen,
}

/// Writes a scene-linear image of 1, 3 or 4 channels as PNG through a view transform, atomically.
pub fn write_png(
    path: &Path,
    image: &Image,
    view: &ViewTransform,
    depth: BitDepth,
) -> Result<(), ImageError> {
    write_shown(path, &view.apply_image(image), depth)
}

/// Writes display colour, 0..1, of 1, 3 or 4 channels as PNG, atomically.
pub fn write_shown(path: &Path, shown: &Image, depth: BitDepth) -> Result<(), ImageError> {
    let color = match shown.channels {
        1 => png::ColorType::Grayscale,
        3 => png::ColorType::Rgb,
        4 => png::ColorType::Rgba,
        n => {
            let reason = format!("a PNG has 1, 3 or 4 channels, not {n}");
            return Err(ImageError::Format { path: path.to_path_buf(), reason });
        }
    };
    let max = if depth == BitDepth::Eight { 255.0 } else { 65535.0 };
    let steps = shown.data.iter().map(|v| (v.clamp(0.0, 1.0) * max).round());
    let bytes: Vec<u8> = match depth {
        BitDepth::Eight => steps.map(|v| v as u8).collect(),
        BitDepth::Sixteen => steps.flat_map(|v| (v as u16).to_be_bytes()).collect(),
    };
    write_atomically(path, |writer| encode(writer, shown, color, depth, &bytes).map_err(io_error))
}

fn encode(
    writer: &mut BufWriter<File>,
    image: &Image,
    color: png::ColorType,
    depth: BitDepth,
    bytes: &[u8],
) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(writer, image.width as u32, image.height as u32);
    encoder.set_color(color);
    encoder.set_depth(if depth == BitDepth::Eight { png::BitDepth::Eight } else { png::BitDepth::Sixteen });
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()
}

fn io_error(error: png::EncodingError) -> io::Error {
    match error {
        png::EncodingError::IoError(error) => error,
        other => io::Error::other(other.to_string()),
    }
}

/// Reads a picture as scene-linear RGB: the `Combined` pass of an EXR, or a PNG decoded by the sRGB curve.
/// Alpha is dropped.
pub fn read_picture(path: &Path) -> Result<Image, ImageError> {
    let format = |reason: &str| ImageError::Format { path: path.to_path_buf(), reason: reason.into() };
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let image = match extension.as_str() {
        "exr" => {
            let image = read_exr(path)?;
            image.get("Combined").cloned().ok_or_else(|| format("it has no Combined pass"))?
        }
        "png" => {
            let mut image = read_png_raw(path)?;
            image.data.iter_mut().for_each(|v| *v = linear_from_srgb(*v));
            image
        }
        _ => return Err(format("give an .exr or .png file")),
    };
    rgb(&image).ok_or_else(|| format("it has no colour channels"))
}

fn rgb(image: &Image) -> Option<Image> {
    let of = |pixel: &[f32]| match *pixel {
        [v] | [v, _] => [v; 3],
        [r, g, b, ..] => [r, g, b],
        [] => [0.0; 3],
    };
    let data = image.data.chunks_exact(image.channels.max(1)).flat_map(of).collect();
    (image.channels > 0).then_some(Image { width: image.width, height: image.height, channels: 3, data })
}

/// The stored values of a PNG, 0..1.
pub(crate) fn read_png_raw(path: &Path) -> Result<Image, ImageError> {
    let read_error = |source| ImageError::Read { path: path.into(), source };
    decode_png_raw(path, &std::fs::read(path).map_err(read_error)?)
}

/// Decodes bytes that nobody vouches for like [`read_png_raw`]; `name` stands in messages.
pub(crate) fn decode_png_raw(name: &Path, file: &[u8]) -> Result<Image, ImageError> {
    let format = |error: png::DecodingError| ImageError::Format {
        path: name.to_path_buf(),
        reason: error.to_string(),
    };
    /// Deflate makes at most 1032 bytes of one, and a pixel of one bit becomes four bytes.
    const MOST_EXPANSION: usize = 1032 * 32;
    let most = file.len().saturating_mul(MOST_EXPANSION);
    let mut decoder = png::Decoder::new(Cursor::new(file));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(format)?;
    let size = reader.output_buffer_size().filter(|&size| size <= most).ok_or_else(|| {
        let reason = "its header promises more pixels than the file can hold".into();
        ImageError::Format { path: name.to_path_buf(), reason }
    })?;
    let mut bytes = vec![0; size];
    let info = reader.next_frame(&mut bytes).map_err(format)?;
    let bytes = &bytes[..info.buffer_size()];
    let data = match info.bit_depth {
        png::BitDepth::Sixteen => {
            bytes.chunks_exact(2).map(|b| u16::from_be_bytes([b[0], b[1]]) as f32 / 65535.0).collect()
        }
        _ => bytes.iter().map(|b| *b as f32 / 255.0).collect(),
    };
    let channels = info.color_type.samples();
    Ok(Image { width: info.width as usize, height: info.height as usize, channels, data })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn png_comes_back_within_half_a_step() {
        let folder = tempfile::tempdir().unwrap();
        let data: Vec<f32> = (0..5 * 4 * 3).map(|i| i as f32 / 59.0).collect();
        let image = Image { width: 5, height: 4, channels: 3, data };
        for (depth, step) in [(BitDepth::Eight, 1.0 / 255.0), (BitDepth::Sixteen, 1.0 / 65535.0)] {
            let path = folder.path().join("picture.png");
            write_png(&path, &image, &ViewTransform::Standard, depth).unwrap();
            let raw = read_png_raw(&path).unwrap();
            let shown = ViewTransform::Standard.apply_image(&image);
            assert!(raw.data.iter().zip(&shown.data).all(|(a, b)| (a - b).abs() <= 0.5001 * step));
            let linear = read_picture(&path).unwrap();
            assert!(linear.data.iter().zip(&image.data).all(|(a, b)| (a - b).abs() <= 1.3 * step));
        }
    }

    #[test]
    fn view_table_survives_its_png() {
        let folder = tempfile::tempdir().unwrap();
        let (size, path) = (5, folder.path().join("view.png"));
        let mut strip = Image::new(size * size, size, 3);
        let mut values = vec![[0.0; 3]; size.pow(3)];
        for (i, value) in values.iter_mut().enumerate() {
            let (r, g, b) = (i % size, i / size % size, i / size / size);
            *value = [r as f32 / 4.0, g as f32 / 4.0, b as f32 / 4.0];
            let at = (g * size * size + b * size + r) * 3;
            strip.data[at..at + 3].copy_from_slice(&value.map(linear_from_srgb));
        }
        write_png(&path, &strip, &ViewTransform::Standard, BitDepth::Sixteen).unwrap();
        let (read, made) =
            (ViewTransform::read_lut(&path).unwrap(), ViewTransform::lut(size, values).unwrap());
        let (got, want) = (read.apply([0.01, 0.4, 3.0]), made.apply([0.01, 0.4, 3.0]));
        assert!((0..3).all(|c| (got[c] - want[c]).abs() < 1e-4), "{got:?} for {want:?}");
    }

    #[test]
    fn more_pixels_than_the_file_can_hold_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("huge.png");
        let image = Image { width: 4, height: 4, channels: 3, data: vec![0.5; 48] };
        write_png(&path, &image, &ViewTransform::Standard, BitDepth::Eight).unwrap();
        let mut bytes = std::fs::read(&path).unwrap();
        // Width and height of the header chunk, and its checksum.
        bytes[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
        let checksum = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&checksum.to_be_bytes());
        std::fs::write(&path, bytes).unwrap();
        let message = read_picture(&path).unwrap_err().to_string();
        assert!(message.contains("more pixels"), "{message}");
    }

    /// The checksum of PNG chunks (ISO 3309), bit by bit.
    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(u32::MAX, |crc, byte| {
            (0..8)
                .fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 })
        })
    }

    #[test]
    fn damaged_and_unknown_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        for (name, bytes) in
            [("broken.png", &b"\x89PNG\r\n\x1a\nxx"[..]), ("text.png", b"hello"), ("a.tga", b"")]
        {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            let message = read_picture(&path).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
    }
}
