use crate::{Alpha, ColorEncoding, Texels, Texture};
use std::io::Cursor;
use std::path::Path;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// A picture file of 8 bits a channel, or made such.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PictureFile {
    /// Pixels per row.
    pub width: usize,
    /// Rows; row 0 is the *bottom* row, as of [`crate::Texture`].
    pub height: usize,
    /// RGBA, alpha as in the file.
    pub texels: Vec<u8>,
    /// Whether the file has 16 bits a channel, of which the upper half is here.
    pub is_deep: bool,
}

const JPEG_START: [u8; 2] = [0xff, 0xd8];
/// Pixels that a byte of a JPEG can hold: a block of 64 in the single bit that says "as before", twice for luck.
const MOST_JPEG_PIXELS: usize = 1024;
/// Deflate makes at most 1032 bytes of one, and a pixel of one bit becomes four bytes.
const MOST_PNG_BYTES: usize = 1032 * 32;

impl PictureFile {
    /// Reads a PNG, or a JPEG of one or three channels; what keeps it from that, in words.
    pub fn read(path: &Path) -> Result<Self, String> {
        let file = std::fs::read(path).map_err(|error| error.to_string())?;
        if file.starts_with(&JPEG_START) { read_jpeg(&file) } else { read_png(&file) }
    }

    /// The picture as a texture of that name.
    pub fn into_texture(self, name: String, encoding: ColorEncoding, alpha: Alpha) -> Texture {
        let texels = Texels::Byte(self.texels);
        Texture { name, width: self.width, height: self.height, texels, encoding, alpha }
    }

    fn from_rows<const N: usize>(
        size: [usize; 2],
        bytes: &[u8],
        is_deep: bool,
        rgba: fn([u8; N]) -> [u8; 4],
    ) -> Self {
        let (pixels, _) = bytes.as_chunks::<N>();
        let mut texels = Vec::with_capacity(4 * pixels.len());
        for row in pixels.chunks_exact(size[0]).rev() {
            texels.extend(row.iter().flat_map(|&pixel| rgba(pixel)));
        }
        Self { width: size[0], height: size[1], texels, is_deep }
    }
}

fn read_png(file: &[u8]) -> Result<PictureFile, String> {
    let mut decoder = png::Decoder::new(Cursor::new(file));
    decoder.set_transformations(
        png::Transformations::EXPAND | png::Transformations::STRIP_16 | png::Transformations::ALPHA,
    );
    let mut reader = decoder.read_info().map_err(|error| format!("{error} (only PNG and JPEG are read)"))?;
    let is_deep = reader.info().bit_depth == png::BitDepth::Sixteen;
    let bytes = reader.output_buffer_size().filter(|&bytes| bytes / MOST_PNG_BYTES <= file.len());
    let mut bytes = vec![0; bytes.ok_or("its header promises more pixels than the file can hold")?];
    let info = reader.next_frame(&mut bytes).map_err(|error| error.to_string())?;
    let (bytes, size) = (&bytes[..info.buffer_size()], [info.width as usize, info.height as usize]);
    Ok(match info.color_type {
        png::ColorType::GrayscaleAlpha => PictureFile::from_rows(size, bytes, is_deep, |[v, a]| [v, v, v, a]),
        _ => PictureFile::from_rows(size, bytes, is_deep, |pixel| pixel),
    })
}

fn read_jpeg(file: &[u8]) -> Result<PictureFile, String> {
    let options = DecoderOptions::default().set_max_width(1 << 15).set_max_height(1 << 15);
    let options = options.jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), options);
    decoder.decode_headers().map_err(|error| error.to_string())?;
    let (width, height) = decoder.dimensions().ok_or("it has no pixels")?;
    if width * height / MOST_JPEG_PIXELS > file.len() {
        return Err("its header promises more pixels than the file can hold".into());
    }
    let channels = decoder.input_colorspace();
    if !matches!(channels, Some(ColorSpace::YCbCr | ColorSpace::Luma | ColorSpace::RGB)) {
        return Err(format!("channels {channels:?} are not read"));
    }
    let bytes = decoder.decode().map_err(|error| error.to_string())?;
    Ok(PictureFile::from_rows([width, height], &bytes, false, |[r, g, b]| [r, g, b, 255]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gradients of 16 x 12 pixels: red to the right, green downwards in the file.
    const JPEG: &[u8] = include_bytes!("../tests/data/gradient.jpg");

    fn written(name: &str, bytes: &[u8]) -> tempfile::TempPath {
        let mut file = tempfile::Builder::new().suffix(name).tempfile().unwrap();
        std::io::Write::write_all(&mut file, bytes).unwrap();
        file.into_temp_path()
    }

    fn png(color: png::ColorType, depth: png::BitDepth, data: &[u8]) -> tempfile::TempPath {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 2);
        encoder.set_color(color);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(data).unwrap();
        written(".png", &bytes)
    }

    #[test]
    fn pngs_of_every_kind_become_rgba_from_the_bottom_row() {
        let gray =
            PictureFile::read(&png(png::ColorType::Grayscale, png::BitDepth::Eight, &[1, 2, 3, 4])).unwrap();
        assert_eq!(gray.texels, [3, 3, 3, 255, 4, 4, 4, 255, 1, 1, 1, 255, 2, 2, 2, 255]);
        let data: Vec<u8> = (0..16).collect();
        let rgba = PictureFile::read(&png(png::ColorType::Rgba, png::BitDepth::Eight, &data)).unwrap();
        assert_eq!(rgba.texels, [8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7]);
        assert!(!rgba.is_deep);
        let deep =
            PictureFile::read(&png(png::ColorType::Grayscale, png::BitDepth::Sixteen, &data[..8])).unwrap();
        assert!(deep.is_deep && deep.texels[..4] == [4, 4, 4, 255]);
    }

    #[test]
    fn a_jpeg_is_read_from_the_bottom_row() {
        let picture = PictureFile::read(&written(".jpg", JPEG)).unwrap();
        assert_eq!((picture.width, picture.height, picture.texels.len()), (16, 12, 16 * 12 * 4));
        let at = |x: usize, y: usize| &picture.texels[4 * (y * 16 + x)..][..4];
        // What Blender 5.2 reads; decoders may round differently.
        let blender = [
            (0, 0, [14, 249, 130, 255]),
            (15, 0, [255, 253, 136, 255]),
            (0, 11, [0, 3, 120, 255]),
            (15, 11, [244, 6, 126, 255]),
            (7, 5, [119, 139, 130, 255]),
            (3, 2, [51, 208, 129, 255]),
        ];
        for (x, y, wanted) in blender {
            let near =
                at(x, y).iter().zip(wanted).all(|(&found, wanted): (_, u8)| found.abs_diff(wanted) <= 2);
            assert!(near, "{x} {y}: {:?}, not {wanted:?}", at(x, y));
        }
    }

    #[test]
    fn damaged_files_are_refused_in_words() {
        for (end, bytes) in [(".jpg", JPEG), (".png", b"\x89PNG\r\n\x1a\n".as_slice()), (".txt", b"hello")] {
            for length in [0, 1, 2, 3, bytes.len() / 3] {
                assert!(PictureFile::read(&written(end, &bytes[..length.min(bytes.len())])).is_err());
            }
        }
        let mut large = JPEG.to_vec();
        let frame = large.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
        large[frame + 5..frame + 9].copy_from_slice(&[0x7f, 0xff, 0x7f, 0xff]);
        let error = PictureFile::read(&written(".jpg", &large)).unwrap_err();
        assert!(error.contains("more pixels"), "{error}");
        assert!(PictureFile::read(Path::new("no such file")).is_err());
    }
}
