//! Pixels of a proxy in few bytes: albedo in 8 bits a channel, normals on an octahedron in twice 10 bits, depth in 16
//! bits of its logarithm. Each is an image, which PNG predicts from its neighbours and deflates.

use glam::{Vec2, Vec2Swizzles, Vec3};
use png::{BitDepth, ColorType};

/// Steps along each axis of the octahedron; an even number, so that the axes themselves are exact.
const NORMAL_STEPS: f32 = 1022.0;
/// Code of no normal, which the octahedron does not use.
const NO_NORMAL: u16 = 1023;
/// Octaves of metres that depths lie in, and the step between neighbours: 0.03 percent.
const DEPTH_OCTAVES: [f32; 2] = [-12.0, 20.0];
const DEPTH_STEP: f32 = (DEPTH_OCTAVES[1] - DEPTH_OCTAVES[0]) / 65_534.0;

/// Kind of PNG that codes are in.
pub(crate) type CodeKind = (ColorType, BitDepth);

pub(crate) const ALBEDO: CodeKind = (ColorType::Rgb, BitDepth::Eight);
pub(crate) const NORMAL: CodeKind = (ColorType::GrayscaleAlpha, BitDepth::Sixteen);
pub(crate) const DEPTH: CodeKind = (ColorType::Grayscale, BitDepth::Sixteen);

/// An image of codes, most significant byte first.
pub(crate) struct CodedImage {
    kind: CodeKind,
    bytes: Vec<u8>,
}

/// Albedo that is clamped to 0..1: steps are even in its square root.
pub(crate) fn encode_albedo(albedo: &[[f32; 3]]) -> CodedImage {
    let code = |value: &f32| (value.clamp(0.0, 1.0).sqrt() * 255.0).round() as u8;
    let bytes = albedo.iter().flatten().map(code).collect();
    CodedImage { kind: ALBEDO, bytes }
}

/// Inverse of [`encode_albedo`].
pub(crate) fn decode_albedo(image: &CodedImage) -> Vec<[f32; 3]> {
    let value = |code: u8| (f32::from(code) / 255.0).powi(2);
    image.bytes.as_chunks().0.iter().map(|codes: &[u8; 3]| codes.map(value)).collect()
}

/// Unit normals; none stays none.
pub(crate) fn encode_normal(normal: &[[f32; 3]]) -> CodedImage {
    let code = |normal: &[f32; 3]| {
        let normal = Vec3::from(*normal);
        let sum = normal.abs().element_sum();
        if sum < 1e-6 {
            return [NO_NORMAL; 2];
        }
        let on = normal / sum;
        let flat = if on.z < 0.0 { folded(on.truncate()) } else { on.truncate() };
        flat.to_array().map(|x| ((x + 1.0) / 2.0 * NORMAL_STEPS).round() as u16)
    };
    let bytes = normal.iter().flat_map(code).flat_map(u16::to_be_bytes).collect();
    CodedImage { kind: NORMAL, bytes }
}

/// Inverse of [`encode_normal`].
pub(crate) fn decode_normal(image: &CodedImage) -> Vec<[f32; 3]> {
    let normal = |codes: &[u16]| {
        if codes.contains(&NO_NORMAL) {
            return [0.0; 3];
        }
        let flat = Vec2::new(f32::from(codes[0]), f32::from(codes[1])) / NORMAL_STEPS * 2.0 - 1.0;
        let z = 1.0 - flat.abs().element_sum();
        let on = if z < 0.0 { folded(flat) } else { flat };
        on.extend(z).normalize_or_zero().to_array()
    };
    words(image).chunks_exact(2).map(normal).collect()
}

/// Upper half of an octahedron to its lower half in the plane, and back.
fn folded(flat: Vec2) -> Vec2 {
    (1.0 - flat.abs().yx()) * flat.signum()
}

/// Distances in metres; zero stays zero.
pub(crate) fn encode_depth(depth: &[f32]) -> CodedImage {
    let code = |depth: &f32| match *depth > 0.0 {
        true => 1 + ((depth.log2() - DEPTH_OCTAVES[0]) / DEPTH_STEP).round().clamp(0.0, 65_534.0) as u16,
        false => 0,
    };
    let bytes = depth.iter().map(code).flat_map(u16::to_be_bytes).collect();
    CodedImage { kind: DEPTH, bytes }
}

/// Inverse of [`encode_depth`].
pub(crate) fn decode_depth(image: &CodedImage) -> Vec<f32> {
    let depth = |code: u16| match code {
        0 => 0.0,
        code => (DEPTH_OCTAVES[0] + f32::from(code - 1) * DEPTH_STEP).exp2(),
    };
    words(image).into_iter().map(depth).collect()
}

fn words(image: &CodedImage) -> Vec<u16> {
    image.bytes.as_chunks().0.iter().map(|bytes| u16::from_be_bytes(*bytes)).collect()
}

impl CodedImage {
    /// The image as a PNG.
    pub fn to_png(&self, width: usize, height: usize) -> Result<Vec<u8>, String> {
        let sizes = [width, height].map(u32::try_from);
        let [Ok(width), Ok(height)] = sizes else { return Err("the picture is too large".into()) };
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_color(self.kind.0);
        encoder.set_depth(self.kind.1);
        let write = |mut writer: png::Writer<&mut Vec<u8>>| {
            writer.write_image_data(&self.bytes)?;
            writer.finish()
        };
        encoder.write_header().and_then(write).map_err(|error| error.to_string())?;
        Ok(file)
    }

    /// Reads a PNG that nobody vouches for, of the kind and size of `like`.
    pub fn from_png(file: &[u8], kind: CodeKind, (width, height): (usize, usize)) -> Result<Self, String> {
        let mut reader =
            png::Decoder::new(std::io::Cursor::new(file)).read_info().map_err(|e| e.to_string())?;
        let info = reader.info();
        let found = ((info.color_type, info.bit_depth), info.width as usize, info.height as usize);
        if found != (kind, width, height) {
            return Err("it is of another size or kind".into());
        }
        // Deflate makes at most 1032 bytes of one.
        let most = file.len().saturating_mul(1032);
        let size = reader.output_buffer_size().filter(|size| *size <= most).ok_or("it is too short")?;
        let mut bytes = vec![0; size];
        reader.next_frame(&mut bytes).map_err(|error| error.to_string())?;
        Ok(Self { kind, bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    #[test]
    fn codes_of_decoded_values_are_the_same_and_close() {
        let mut rng = Rng::stream(1, 2, 3);
        let mut normal: Vec<[f32; 3]> = (0..4000)
            .map(|_| Vec3::from_array([(); 3].map(|()| rng.next_normal())).normalize().to_array())
            .collect();
        normal.extend(
            [Vec3::ZERO, Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z]
                .map(|axis| axis.to_array()),
        );
        let decoded = decode_normal(&encode_normal(&normal));
        assert_eq!(decode_normal(&encode_normal(&decoded)), decoded);
        for (a, b) in normal.iter().zip(&decoded) {
            // Half a step along both axes, and as much along z, where the octahedron is nearest to its middle.
            assert!(Vec3::from(*a).distance(Vec3::from(*b)) < 4.2e-3, "{a:?} {b:?}");
        }
        assert_eq!(decoded[4000..], normal[4000..], "axes are exact");

        let depth: Vec<f32> = (0..4000).map(|_| (2.0 * rng.next_normal()).exp()).chain([0.0, 1e9]).collect();
        let decoded = decode_depth(&encode_depth(&depth));
        assert_eq!(decode_depth(&encode_depth(&decoded)), decoded);
        assert!(depth.iter().zip(&decoded).take(4001).all(|(a, b)| (a - b).abs() <= 2e-4 * a));

        let albedo: Vec<[f32; 3]> = (0..4000).map(|_| [(); 3].map(|()| rng.next_f32())).collect();
        let decoded = decode_albedo(&encode_albedo(&albedo));
        assert_eq!(decode_albedo(&encode_albedo(&decoded)), decoded);
        let differences = albedo.iter().flatten().zip(decoded.iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(differences.fold(0.0, f32::max) < 4.1e-3);
    }

    #[test]
    fn files_of_another_size_or_kind_are_refused() {
        let image = encode_depth(&[1.0; 12]);
        let file = image.to_png(4, 3).unwrap();
        assert_eq!(CodedImage::from_png(&file, DEPTH, (4, 3)).unwrap().bytes, image.bytes);
        assert!(CodedImage::from_png(&file, DEPTH, (3, 4)).is_err());
        assert!(CodedImage::from_png(&file, ALBEDO, (4, 3)).is_err());
        assert!(CodedImage::from_png(&file[..file.len() - 20], DEPTH, (4, 3)).is_err());
    }
}
