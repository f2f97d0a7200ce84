use crate::{Image, ImageError};
use rayon::prelude::*;
use std::path::Path;

/// Conversion of scene-linear colour to display colour.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ViewTransform {
    /// Blender's "Standard" on an sRGB display: the sRGB curve, clipped to 0..1.
    #[default]
    Standard,
    /// Any other view (AgX, Filmic, looks, exposure, curves), sampled from Blender itself.
    Lut(Lut),
}

/// A 3D table over log-spaced scene-linear colour: table coordinate `log2(x + 2^-12)` from -12 to 7, trilinear.
#[derive(Clone, Debug, PartialEq)]
pub struct Lut {
    /// Entries along each axis.
    size: usize,
    /// `size^3` display colours, red fastest, then green, then blue.
    values: Vec<[f32; 3]>,
}

const SHAPER_OFFSET: f32 = 1.0 / 4096.0;
const SHAPER_MIN: f32 = -12.0;
const SHAPER_MAX: f32 = 7.0;

impl ViewTransform {
    /// A table of `size^3` display colours, red fastest, then green, then blue; entry `i` of an axis stands for
    /// the scene-linear value [`ViewTransform::lut_input`]`(i, size)`. None if the count does not fit.
    pub fn lut(size: usize, values: Vec<[f32; 3]>) -> Option<Self> {
        let fits = size >= 2 && size.checked_pow(3) == Some(values.len());
        fits.then_some(Self::Lut(Lut { size, values }))
    }

    /// Scene-linear value of entry `index` of a table's axis.
    pub fn lut_input(index: usize, size: usize) -> f32 {
        let log = SHAPER_MIN + (SHAPER_MAX - SHAPER_MIN) * index as f32 / (size - 1) as f32;
        (log.exp2() - SHAPER_OFFSET).max(0.0)
    }

    /// Reads a table from a PNG of `size * size` by `size` pixels, stored values unchanged: column
    /// `blue * size + red`, row `green` from the top.
    pub fn read_lut(path: &Path) -> Result<Self, ImageError> {
        Self::of_table(path, &crate::picture::read_png_raw(path)?)
    }

    /// Decodes the bytes of a file like [`ViewTransform::read_lut`]; `name` stands in messages.
    pub fn decode_lut(name: &Path, file: &[u8]) -> Result<Self, ImageError> {
        Self::of_table(name, &crate::picture::decode_png_raw(name, file)?)
    }

    fn of_table(name: &Path, image: &Image) -> Result<Self, ImageError> {
        let size = image.height;
        if image.channels < 3 || image.width != size * size || size < 2 {
            let reason = format!("a view table is N*N by N pixels, this is {} by {size}", image.width);
            return Err(ImageError::Format { path: name.to_path_buf(), reason });
        }
        let mut values = Vec::with_capacity(size * size * size);
        for blue in 0..size {
            for green in 0..size {
                for red in 0..size {
                    let pixel = image.pixel(blue * size + red, green);
                    values.push([pixel[0], pixel[1], pixel[2]]);
                }
            }
        }
        Ok(Self::Lut(Lut { size, values }))
    }

    /// Display colour, 0..1, of a scene-linear colour.
    pub fn apply(&self, color: [f32; 3]) -> [f32; 3] {
        match self {
            Self::Standard => color.map(srgb_from_linear),
            Self::Lut(lut) => lut.sample(color),
        }
    }

    /// Display picture of a scene-linear one of 1, 3 or 4 channels; alpha is premultiplied going in (as in EXR)
    /// and straight coming out (as in PNG).
    pub fn apply_image(&self, image: &Image) -> Image {
        let mut out = image.clone();
        out.data.par_chunks_exact_mut(image.channels.max(1)).for_each(|pixel| match pixel {
            [v] => *v = self.apply([*v; 3])[0],
            [r, g, b] => [*r, *g, *b] = self.apply([*r, *g, *b]),
            [r, g, b, a, ..] => {
                *a = a.clamp(0.0, 1.0);
                let straight = if *a > 0.0 { 1.0 / *a } else { 0.0 };
                [*r, *g, *b] = self.apply([*r * straight, *g * straight, *b * straight]);
            }
            _ => {}
        });
        out
    }
}

impl Lut {
    fn sample(&self, color: [f32; 3]) -> [f32; 3] {
        let last = (self.size - 1) as f32;
        let scale = last / (SHAPER_MAX - SHAPER_MIN);
        // `max` also turns NaN into black.
        let at = color.map(|x| (((x.max(0.0) + SHAPER_OFFSET).log2() - SHAPER_MIN) * scale).clamp(0.0, last));
        let low = at.map(|x| (x as usize).min(self.size - 2));
        let t: [f32; 3] = std::array::from_fn(|c| at[c] - low[c] as f32);
        let mut out = [0.0; 3];
        for corner in 0..8 {
            let bit: [usize; 3] = std::array::from_fn(|c| corner >> c & 1);
            let weight: f32 = (0..3).map(|c| if bit[c] == 1 { t[c] } else { 1.0 - t[c] }).product();
            let [r, g, b]: [usize; 3] = std::array::from_fn(|c| low[c] + bit[c]);
            let value = self.values[(b * self.size + g) * self.size + r];
            for c in 0..3 {
                out[c] += weight * value[c];
            }
        }
        out
    }
}

/// The sRGB curve (IEC 61966-2-1), clipped to 0..1; NaN becomes 0.
pub fn srgb_from_linear(linear: f32) -> f32 {
    let x = linear.max(0.0).clamp(0.0, 1.0);
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of the sRGB curve.
pub fn linear_from_srgb(encoded: f32) -> f32 {
    let x = encoded.max(0.0).clamp(0.0, 1.0);
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(size: usize, f: impl Fn([f32; 3]) -> [f32; 3]) -> ViewTransform {
        let axis = |i| ViewTransform::lut_input(i, size);
        let values = (0..size.pow(3))
            .map(|i| f([axis(i % size), axis(i / size % size), axis(i / size / size)]))
            .collect();
        ViewTransform::lut(size, values).unwrap()
    }

    #[test]
    fn standard_shows_middle_grey_as_blender_does() {
        // Measured in Blender: scene-linear 0.18 is 0.461 on an sRGB display.
        assert!((ViewTransform::Standard.apply([0.18; 3])[0] - 0.4613).abs() < 1e-3);
        let [over, under, nan] = ViewTransform::Standard.apply([7.0, -1.0, f32::NAN]);
        assert!((over - 1.0).abs() < 1e-6 && under == 0.0 && nan == 0.0);
    }

    #[test]
    fn srgb_curve_inverts() {
        for i in 0..=1000 {
            let x = i as f32 / 1000.0;
            assert!((linear_from_srgb(srgb_from_linear(x)) - x).abs() < 1e-5);
        }
    }

    #[test]
    fn lut_reproduces_a_smooth_view_and_keeps_axes_apart() {
        let view =
            |c: [f32; 3]| [c[0] / (1.0 + c[0]), (c[1] / (1.0 + c[1])).sqrt(), 0.25 * c[2] / (0.3 + c[2])];
        let lut = table(33, view);
        for color in [[0.18, 0.5, 0.02], [1.0, 0.0, 12.0], [0.003, 90.0, 0.7]] {
            let (got, want) = (lut.apply(color), view(color));
            for c in 0..3 {
                assert!((got[c] - want[c]).abs() < 3.0 / 255.0, "{color:?}: {got:?} for {want:?}");
            }
        }
        // Outside the table the ends hold, and NaN is black.
        assert_eq!(lut.apply([f32::NAN, 1e9, -3.0])[0], 0.0);
        assert!((lut.apply([0.0, 1e9, 0.0])[1] - view([0.0, 128.0, 0.0])[1]).abs() < 1e-4);
    }

    #[test]
    fn alpha_is_unpremultiplied_before_the_view() {
        let image = Image { width: 1, height: 1, channels: 4, data: vec![0.09, 0.09, 0.09, 0.5] };
        let shown = ViewTransform::Standard.apply_image(&image);
        assert!((shown.data[0] - 0.4613).abs() < 1e-3);
        assert_eq!(shown.data[3], 0.5);
    }

    #[test]
    fn table_of_a_wrong_count_is_refused() {
        assert!(ViewTransform::lut(3, vec![[0.0; 3]; 26]).is_none());
        assert!(ViewTransform::lut(1, vec![[0.0; 3]]).is_none());
    }
}
