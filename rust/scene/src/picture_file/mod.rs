//! Picture files: the values that they store, and what Blender makes of those for its textures.
//!
//! Files are untrusted. Every decoder compares what a header promises with what a file of that length can hold before
//! it takes memory, and refuses in words what it cannot read as Blender does; Blender itself may then.

mod exr;
mod jpeg;
mod png;
mod radiance;
mod tiff;

use crate::{Alpha, ColorEncoding, Texels, Texture};
use glam::{Mat3, Vec3};
use rayon::prelude::*;
use std::io::Read;
use std::path::Path;

/// A decoded picture file.
#[derive(Clone, Debug)]
pub struct PictureFile {
    /// Pixels per row.
    pub width: usize,
    /// Rows; row 0 is the *bottom* row, as of [`crate::Texture`].
    pub height: usize,
    /// RGBA as stored; bytes for 8 bits a channel, else floats, 1 for the largest integer.
    pub texels: Texels,
}

/// Meaning of the values of a picture file, which only its user knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FileColors {
    /// Colours, encoded by the sRGB curve.
    Srgb,
    /// Scene-linear colours.
    Linear,
    /// Numbers (Blender's Non-Color), which alpha never touches.
    Data,
}

type Decode = fn(&[u8]) -> Result<PictureFile, String>;

/// First bytes of a kind of file, and its decoder.
const KINDS: [(&[u8], Decode); 8] = [
    (b"\x89PNG\r\n\x1a\n", png::decode),
    (b"\xff\xd8", jpeg::decode),
    (b"\x76\x2f\x31\x01", exr::decode),
    (b"II*\0", tiff::decode),
    (b"MM\0*", tiff::decode),
    (b"II+\0", tiff::decode),
    (b"MM\0+", tiff::decode),
    (b"#?", radiance::decode),
];
const LONGEST_START: u64 = 8;
/// Step of 16 bits a channel, as a factor, as Blender has it: divided they differ by a rounding.
const STEP: f32 = 1.0 / 65535.0;
const UNKNOWN: &str = "it is no PNG, JPEG, OpenEXR, TIFF or Radiance file";

impl PictureFile {
    /// Reads a file; what keeps it from that, in words. Of a file of another kind no more than the start is read.
    pub fn read(path: &Path) -> Result<Self, String> {
        let words = |error: std::io::Error| error.to_string();
        let mut file = std::fs::File::open(path).map_err(words)?;
        let mut bytes = Vec::new();
        file.by_ref().take(LONGEST_START).read_to_end(&mut bytes).map_err(words)?;
        decoder(&bytes).ok_or(UNKNOWN)?;
        file.read_to_end(&mut bytes).map_err(words)?;
        Self::decode(&bytes)
    }

    /// Decodes the bytes of a file, such as one that is packed into another.
    pub fn decode(file: &[u8]) -> Result<Self, String> {
        decoder(file).ok_or(UNKNOWN)?(file)
    }

    /// The picture as a texture of that name, with the values that Blender has: bytes stay encoded with straight alpha,
    /// floats become scene-linear and multiplied by alpha, and data stay what they are. Where the scene's linear space is
    /// not that of Rec. 709, `scene_from_rec709` turns floats into it; Blender does not turn bytes either.
    pub fn into_texture(
        mut self,
        name: String,
        colors: FileColors,
        alpha: Alpha,
        scene_from_rec709: Option<Mat3>,
    ) -> Texture {
        let encoding = match (&mut self.texels, colors) {
            (_, FileColors::Data) => ColorEncoding::Linear,
            (Texels::Byte(texels), _) => {
                straighten(texels, alpha);
                if colors == FileColors::Srgb { ColorEncoding::Srgb } else { ColorEncoding::Linear }
            }
            (Texels::Float(texels), _) => {
                associate(texels, alpha);
                if colors == FileColors::Srgb {
                    decode_srgb(texels, alpha);
                }
                if let Some(scene_from_rec709) = scene_from_rec709 {
                    turn(texels, scene_from_rec709);
                }
                ColorEncoding::Linear
            }
        };
        Texture { name, width: self.width, height: self.height, texels: self.texels, encoding, alpha }
    }

    /// Texels from rows of pixels of N values, top row first.
    fn from_rows<T: Copy, const N: usize>(
        [width, height]: [usize; 2],
        values: &[T],
        rgba: impl Fn([T; N]) -> [T; 4],
        texels: fn(Vec<T>) -> Texels,
    ) -> Self {
        let (pixels, _) = values.as_chunks::<N>();
        let mut found = Vec::with_capacity(4 * pixels.len());
        for row in pixels.chunks_exact(width).rev() {
            found.extend(row.iter().flat_map(|&pixel| rgba(pixel)));
        }
        Self { width, height, texels: texels(found) }
    }
}

fn decoder(start: &[u8]) -> Option<Decode> {
    KINDS.into_iter().find(|(magic, _)| start.starts_with(magic)).map(|(_, decode)| decode)
}

/// The size of a picture in a file of `length` bytes, each of which stands for at most `most` bytes of pixels.
fn checked_size(
    width: usize,
    height: usize,
    bytes_per_pixel: usize,
    length: usize,
    most: usize,
) -> Result<[usize; 2], String> {
    if width == 0 || height == 0 {
        return Err("it has no pixels".into());
    }
    let promised = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(bytes_per_pixel));
    let holds = promised.is_some_and(|promised| promised / most <= length);
    holds.then_some([width, height]).ok_or("its header promises more pixels than the file can hold".into())
}

/// Divides colours by alpha, like Blender's `IMB_unpremultiply_rect` and `IMB_rectfill_alpha`.
fn straighten(texels: &mut [u8], alpha: Alpha) {
    let (pixels, _) = texels.as_chunks_mut::<4>();
    match alpha {
        Alpha::None => pixels.iter_mut().for_each(|pixel| pixel[3] = 255),
        Alpha::Premultiplied => pixels.par_iter_mut().for_each(|pixel| {
            let factor = if pixel[3] == 0 { 1.0 } else { 1.0 / f32::from(pixel[3]) };
            for value in &mut pixel[..3] {
                *value = (f32::from(*value) * factor * 255.0 + 0.5).min(255.0) as u8;
            }
        }),
        Alpha::Straight | Alpha::ChannelPacked => {}
    }
}

fn associate(texels: &mut [f32], alpha: Alpha) {
    let (pixels, _) = texels.as_chunks_mut::<4>();
    match alpha {
        Alpha::None => pixels.iter_mut().for_each(|pixel| pixel[3] = 1.0),
        Alpha::Straight => pixels.par_iter_mut().for_each(|[red, green, blue, alpha]| {
            *red *= *alpha;
            *green *= *alpha;
            *blue *= *alpha;
        }),
        Alpha::Premultiplied | Alpha::ChannelPacked => {}
    }
}

/// The sRGB curve of colours that are multiplied by alpha, as Blender: divided by it meanwhile, except where it is 0.
fn decode_srgb(texels: &mut [f32], alpha: Alpha) {
    let divides = alpha != Alpha::ChannelPacked;
    let (pixels, _) = texels.as_chunks_mut::<4>();
    pixels.par_iter_mut().for_each(|pixel| {
        let by = if divides && pixel[3] != 0.0 { pixel[3] } else { 1.0 };
        for value in &mut pixel[..3] {
            *value = linear_from_srgb(*value / by) * by;
        }
    });
}

/// Into another linear space; colours may be multiplied by alpha.
fn turn(texels: &mut [f32], scene_from_rec709: Mat3) {
    let (pixels, _) = texels.as_chunks_mut::<4>();
    pixels.par_iter_mut().for_each(|[r, g, b, _]| {
        [*r, *g, *b] = (scene_from_rec709 * Vec3::new(*r, *g, *b)).to_array();
    });
}

/// IEC 61966-2-1, its straight part continued below 0.
fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded > 0.04045 { ((encoded + 0.055) / 1.055).powf(2.4) } else { encoded / 12.92 }
}

#[cfg(test)]
mod tests;
