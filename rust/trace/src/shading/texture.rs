//! Image sampling as Cycles does it: filtered in the file's encoding, then decoded.

use std::sync::LazyLock;

use glam::{Vec3, Vec4};
use relume_scene::{Alpha, ColorEncoding, Extension, Interpolation, Texels, Texture, associate};

/// Part of an image that does not depend on where it is sampled.
#[derive(Debug)]
pub struct PreparedTexture {
    /// Byte texels multiplied by their alpha, if that differs from the scene's.
    associated: Option<Vec<u8>>,
}

impl PreparedTexture {
    /// Colours of images with alpha are filtered multiplied by it, unless alpha is unrelated or the image is data.
    pub fn new(texture: &Texture) -> Self {
        let is_color = texture.encoding == ColorEncoding::Srgb;
        let is_alpha = matches!(texture.alpha, Alpha::Straight | Alpha::Premultiplied);
        let associated = match &texture.texels {
            Texels::Byte(bytes)
                if is_color && is_alpha && bytes.chunks_exact(4).any(|texel| texel[3] != 255) =>
            {
                Some(bytes.chunks_exact(4).flat_map(associate).collect())
            }
            _ => None,
        };
        Self { associated }
    }

    /// True if colours are stored multiplied by alpha.
    fn is_associated(&self, texture: &Texture) -> bool {
        match texture.texels {
            Texels::Byte(_) => self.associated.is_some(),
            Texels::Float(_) => matches!(texture.alpha, Alpha::Straight | Alpha::Premultiplied),
        }
    }

    /// Scene-linear colour and alpha at `uv`. `straight` asks for colours divided by alpha, which Cycles does where
    /// the node's alpha output is in use.
    pub fn sample(
        &self,
        texture: &Texture,
        uv: [f32; 2],
        interpolation: Interpolation,
        extension: Extension,
        straight: bool,
    ) -> Vec4 {
        let (width, height) = (texture.width, texture.height);
        let image = TextureImage { texels: self.texels(texture), width, height, extension, first: 0 };
        let mut value = image.filter(uv, interpolation);
        if straight && value.w != 0.0 && value.w != 1.0 && self.is_associated(texture) {
            value = (value.truncate() / value.w).extend(value.w);
        }
        if texture.encoding == ColorEncoding::Srgb && matches!(texture.texels, Texels::Byte(_)) {
            value = value.truncate().map(linear_from_srgb).extend(value.w);
        }
        if texture.alpha == Alpha::None {
            value.w = 1.0;
        }
        value
    }

    /// Values of a 3D image of data at a place of the unit cube, whose layers across z lie one above another.
    pub fn sample_layers(
        &self,
        texture: &Texture,
        [x, y, z]: [f32; 3],
        count: usize,
        interpolation: Interpolation,
        extension: Extension,
    ) -> Vec4 {
        let (width, height) = (texture.width, texture.height / count);
        let image = TextureImage { texels: self.texels(texture), width, height, extension, first: 0 };
        let weighted = |(layer, weight): (Option<usize>, f32)| {
            let Some(layer) = layer.filter(|_| weight > 0.0) else { return Vec4::ZERO };
            let image = TextureImage { first: layer * width * height, ..image };
            image.filter([x, y], interpolation) * weight
        };
        image.weights(z, count, interpolation).into_iter().map(weighted).sum()
    }

    fn texels<'a>(&'a self, texture: &'a Texture) -> TexelGrid<'a> {
        match (&self.associated, &texture.texels) {
            (Some(bytes), _) => TexelGrid::Byte(bytes),
            (None, Texels::Byte(bytes)) => TexelGrid::Byte(bytes),
            (None, Texels::Float(floats)) => TexelGrid::Float(floats),
        }
    }
}

/// Decodes sRGB by a table that is linear between 4096 steps (error below 2e-7 of full scale above the toe).
fn linear_from_srgb(encoded: f32) -> f32 {
    const STEPS: usize = 4096;
    static TABLE: LazyLock<Vec<f32>> =
        LazyLock::new(|| (0..=STEPS + 1).map(|i| exact_linear_from_srgb(i as f32 / STEPS as f32)).collect());
    if !(0.0..=1.0).contains(&encoded) {
        return exact_linear_from_srgb(encoded);
    }
    let position = encoded * STEPS as f32;
    let index = position as usize;
    let fraction = position - index as f32;
    TABLE[index] + (TABLE[index + 1] - TABLE[index]) * fraction
}

/// IEC 61966-2-1; 0 for negative values, as in Cycles.
fn exact_linear_from_srgb(encoded: f32) -> f32 {
    if encoded < 0.04045 { (encoded / 12.92).max(0.0) } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

#[derive(Clone, Copy)]
enum TexelGrid<'a> {
    Byte(&'a [u8]),
    Float(&'a [f32]),
}

/// An image with what lies outside of it.
#[derive(Clone, Copy)]
struct TextureImage<'a> {
    texels: TexelGrid<'a>,
    width: usize,
    height: usize,
    extension: Extension,
    /// Place of its first texel in the grid, counted in texels.
    first: usize,
}

impl TextureImage<'_> {
    /// Places among `count` along an axis that have a part in the value at `u`, and their weights. What lies outside is nothing.
    fn weights(&self, u: f32, count: usize, interpolation: Interpolation) -> [(Option<usize>, f32); 4] {
        let at = self.reduce(u) * count as f32;
        let (middle, fraction) = cell(if interpolation == Interpolation::Closest { at } else { at - 0.5 });
        let weights = match interpolation {
            Interpolation::Closest => [0.0, 1.0, 0.0, 0.0],
            Interpolation::Linear => [0.0, 1.0 - fraction, fraction, 0.0],
            Interpolation::Cubic => cubic_weights(fraction),
        };
        [-1, 0, 1, 2].map(|step| (self.wrap(middle + step, count), weights[(step + 1) as usize]))
    }

    fn filter(&self, uv: [f32; 2], interpolation: Interpolation) -> Vec4 {
        let x = self.reduce(uv[0]) * self.width as f32;
        let y = self.reduce(uv[1]) * self.height as f32;
        match interpolation {
            Interpolation::Closest => self.texel(self.column(cell(x).0), self.row(cell(y).0)),
            Interpolation::Linear => {
                let ((x, s), (y, t)) = (cell(x - 0.5), cell(y - 0.5));
                let (left, right) = (self.column(x), self.column(x + 1));
                let (below, above) = (self.row(y), self.row(y + 1));
                let bottom = self.texel(left, below) * (1.0 - s) + self.texel(right, below) * s;
                let top = self.texel(left, above) * (1.0 - s) + self.texel(right, above) * s;
                bottom * (1.0 - t) + top * t
            }
            Interpolation::Cubic => {
                let ((x, s), (y, t)) = (cell(x - 0.5), cell(y - 0.5));
                let (across, along) = (cubic_weights(s), cubic_weights(t));
                let columns = [-1, 0, 1, 2].map(|i| self.column(x + i));
                let rows = [-1, 0, 1, 2].map(|i| self.row(y + i));
                let mut sum = Vec4::ZERO;
                for (row, weight) in rows.into_iter().zip(along) {
                    for (column, fraction) in columns.into_iter().zip(across) {
                        sum += self.texel(column, row) * (weight * fraction);
                    }
                }
                sum
            }
        }
    }

    /// A coordinate brought close to 0..1 without a change of what is there; what is not a number, or too large to
    /// have a fraction, reads at 0.
    fn reduce(&self, u: f32) -> f32 {
        match self.extension {
            _ if u.is_nan() => 0.0,
            Extension::Extend | Extension::Clip => u.clamp(-4.0, 5.0),
            _ if u.abs() > 1e6 => 0.0,
            Extension::Repeat => cell(u).1,
            Extension::Mirror => 2.0 * cell(u * 0.5).1,
        }
    }

    fn column(&self, i: i32) -> Option<usize> {
        self.wrap(i, self.width)
    }

    fn row(&self, i: i32) -> Option<usize> {
        self.wrap(i, self.height)
    }

    fn wrap(&self, i: i32, size: usize) -> Option<usize> {
        let count = size as i32;
        if (0..count).contains(&i) {
            return Some(i as usize);
        }
        match self.extension {
            Extension::Repeat => Some(i.rem_euclid(count) as usize),
            Extension::Extend => Some(i.clamp(0, count - 1) as usize),
            Extension::Clip => None,
            Extension::Mirror => {
                let i = i.rem_euclid(2 * count);
                Some(if i < count { i } else { 2 * count - 1 - i } as usize)
            }
        }
    }

    /// The texel at a place inside the image; nothing is transparent black.
    fn texel(&self, x: Option<usize>, y: Option<usize>) -> Vec4 {
        let (Some(x), Some(y)) = (x, y) else { return Vec4::ZERO };
        let index = 4 * (self.first + y * self.width + x);
        match self.texels {
            TexelGrid::Byte(bytes) => {
                let texel = &bytes[index..index + 4];
                Vec4::new(texel[0].into(), texel[1].into(), texel[2].into(), texel[3].into()) * (1.0 / 255.0)
            }
            TexelGrid::Float(floats) => Vec4::from_slice(&floats[index..index + 4]),
        }
    }
}

/// The whole number below a number within 32 bits, and the rest. (`f32::floor` is a library call on processors
/// without SSE 4.1, for which we build.)
fn cell(x: f32) -> (i32, f32) {
    let toward_zero = x as i32;
    let below = if (toward_zero as f32) > x { toward_zero - 1 } else { toward_zero };
    (below, x - below as f32)
}

/// Weights of the cubic B-spline for the four texels about a point at fraction `t`.
fn cubic_weights(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    [
        s * s * s / 6.0,
        (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
        (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0,
        t * t * t / 6.0,
    ]
}

/// Position of a direction on an equirectangular map.
pub fn equirectangular(direction: Vec3) -> [f32; 2] {
    use std::f32::consts::{PI, TAU};
    let u = -direction.y.atan2(direction.x) / TAU + 0.5;
    let v = direction.z.atan2(direction.x.hypot(direction.y)) / PI + 0.5;
    [u, v]
}

/// The texture with the given bytes, for tests.
#[cfg(test)]
pub fn byte_texture(
    width: usize,
    height: usize,
    texels: Vec<u8>,
    encoding: ColorEncoding,
    alpha: Alpha,
) -> Texture {
    Texture { name: "test".into(), width, height, texels: Texels::Byte(texels), encoding, alpha }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(texture: &Texture, uv: [f32; 2], interpolation: Interpolation, extension: Extension) -> Vec4 {
        PreparedTexture::new(texture).sample(texture, uv, interpolation, extension, false)
    }

    fn ramp() -> Texture {
        let texels = (0..4).flat_map(|i| [i * 60, 0, 0, 255]).collect();
        byte_texture(4, 1, texels, ColorEncoding::Linear, Alpha::Straight)
    }

    #[test]
    fn filters_reproduce_texels_and_ramps() {
        let texture = ramp();
        let at =
            |u: f32, interpolation| sample(&texture, [u, 0.5], interpolation, Extension::Extend).x * 255.0;
        assert!((at(0.375, Interpolation::Linear) - 60.0).abs() < 1e-3);
        assert!((at(0.5, Interpolation::Linear) - 90.0).abs() < 1e-3);
        assert!((at(0.49, Interpolation::Closest) - 60.0).abs() < 1e-3);
        // A B-spline keeps straight lines.
        assert!((at(0.5, Interpolation::Cubic) - 90.0).abs() < 1e-3);
    }

    #[test]
    fn extensions_differ_outside() {
        let texture = ramp();
        let at = |u: f32, extension| {
            let value = sample(&texture, [u, 0.5], Interpolation::Closest, extension);
            (value.x * 255.0).round()
        };
        assert_eq!(at(1.1, Extension::Repeat), 0.0);
        assert_eq!(at(-0.1, Extension::Repeat), 180.0);
        assert_eq!(at(1.1, Extension::Extend), 180.0);
        assert_eq!(at(1.1, Extension::Mirror), 180.0);
        assert_eq!(at(1.4, Extension::Mirror), 120.0);
        assert_eq!(at(-0.3, Extension::Mirror), 60.0);
        let clipped = sample(&texture, [1.2, 0.5], Interpolation::Linear, Extension::Clip);
        assert_eq!(clipped, Vec4::ZERO);
        for u in [f32::NAN, f32::INFINITY, -1e30] {
            assert!(sample(&texture, [u, u], Interpolation::Linear, Extension::Repeat).is_finite());
        }
    }

    /// 3 x 4 x 5 values; linear functions stay what they are between places of any filter that is symmetric.
    #[test]
    fn layers_are_filtered_along_three_axes() {
        let size = [3, 4, 5];
        let function = |[x, y, z]: [f32; 3]| 1.0 + x - 2.0 * y + 3.0 * z;
        let place = |n: usize| [n % 3, n / 3 % 4, n / 12].map(|place| place as f32);
        let texels = (0..60).flat_map(|n| [function(place(n)), 0.0, 0.0, 1.0]).collect();
        let texture = Texture {
            name: "test".into(),
            width: size[0],
            height: size[1] * size[2],
            texels: Texels::Float(texels),
            encoding: ColorEncoding::Linear,
            alpha: Alpha::ChannelPacked,
        };
        let at = |place: [f32; 3], interpolation| {
            let unit = std::array::from_fn(|axis| (place[axis] + 0.5) / size[axis] as f32);
            PreparedTexture::new(&texture).sample_layers(&texture, unit, 5, interpolation, Extension::Clip)
        };
        let inside = [1.0, 1.3, 2.4];
        assert!((at(inside, Interpolation::Linear).x - function(inside)).abs() < 1e-5);
        assert!((at(inside, Interpolation::Closest).x - function([1.0, 1.0, 2.0])).abs() < 1e-5);
        assert!((at(inside, Interpolation::Cubic).x - function(inside)).abs() < 1e-5);
        // Half of it lies outside: the first row of the next layer is no part of this one.
        assert!((at([1.0, 3.5, 2.0], Interpolation::Linear).w - 0.5).abs() < 1e-5);
        assert!((at([1.0, 2.0, 4.5], Interpolation::Linear).w - 0.5).abs() < 1e-5);
        assert_eq!(at([1.0, 2.0, 4.6], Interpolation::Closest), Vec4::ZERO);
        assert_eq!(at([f32::NAN, f32::INFINITY, -1e30], Interpolation::Linear), Vec4::ZERO);
    }

    #[test]
    fn srgb_is_decoded_after_filtering() {
        let texture =
            byte_texture(2, 1, vec![0, 0, 0, 255, 255, 255, 255, 255], ColorEncoding::Srgb, Alpha::Straight);
        let middle = sample(&texture, [0.5, 0.5], Interpolation::Linear, Extension::Extend).x;
        assert!((middle - exact_linear_from_srgb(0.5)).abs() < 1e-5);
        for i in 0..=1000 {
            let x = i as f32 / 1000.0;
            assert!((linear_from_srgb(x) - exact_linear_from_srgb(x)).abs() < 1e-6);
        }
    }

    #[test]
    fn colour_is_associated_unless_alpha_is_used() {
        let texels = vec![200, 100, 50, 128];
        let texture = byte_texture(1, 1, texels, ColorEncoding::Srgb, Alpha::Straight);
        let prepared = PreparedTexture::new(&texture);
        let at = |straight| {
            prepared.sample(&texture, [0.5, 0.5], Interpolation::Linear, Extension::Repeat, straight)
        };
        assert!((at(true).x - exact_linear_from_srgb(200.0 / 255.0)).abs() < 0.01);
        assert!((at(false).x - exact_linear_from_srgb(100.0 / 255.0)).abs() < 0.01);
        assert!((at(false).w - 128.0 / 255.0).abs() < 1e-6);
    }

    #[test]
    fn equirectangular_puts_the_poles_at_the_ends() {
        assert_eq!(equirectangular(Vec3::X), [0.5, 0.5]);
        assert!((equirectangular(Vec3::Z)[1] - 1.0).abs() < 1e-6);
        assert!((equirectangular(Vec3::Y)[0] - 0.25).abs() < 1e-6);
    }
}
