//! Networks in sums of 64 bits, a pixel at a time: what the kernels of a device are held against.

use rayon::prelude::*;

use super::matrices::ByMatrices;
use super::network::{Matrix, Parts};
use super::proxy::{GpuProxy, grow};
use crate::analytic::{FEATURES, PixelSurface, Real, features, seen_values};
use crate::scene_cache::{FACTOR, SURFACE};
use crate::{LightParams, Proxy, ProxyError};

/// Most pixels of an image that are compared.
const COMPARED: usize = 1024;

impl GpuProxy {
    /// Largest error of an image that is made by matrices or not, as a share of its largest value, at pixels from all over it, against
    /// sums of 64 bits; infinite if a value anywhere was not written or is no number. Nothing where there is no such kernel.
    ///
    /// # Errors
    /// If there is no room for the image, or the device was lost.
    pub fn error(&self, light: &LightParams, by_matrices: bool) -> Result<Option<f64>, ProxyError> {
        let Some(matrices) = self.matrices_or_plain(by_matrices) else { return Ok(None) };
        self.error_of(light, matrices).map(Some)
    }

    /// [`GpuProxy::error`] by these matrices, or by the plain kernel.
    pub(super) fn error_of(
        &self,
        light: &LightParams,
        matrices: Option<&ByMatrices>,
    ) -> Result<f64, ProxyError> {
        let count = self.proxy().features().pixel_count();
        {
            let shared = &mut *self.shared();
            grow(self.gpu(), &mut shared.units, 3 * count)?;
            self.gpu().write(&shared.units, 0, &vec![f32::NAN; shared.units.len()]);
        }
        let found = self.whole_image(light, matrices)?;
        let pixels: Vec<u32> = (0..count as u32).step_by(count.div_ceil(COMPARED)).collect();
        let expected = exact_pixels(self.proxy(), &pixels, light);
        if !found.iter().all(|value| value.is_finite()) {
            return Ok(f64::INFINITY);
        }
        let found = pixels.iter().flat_map(|&pixel| &found[3 * pixel as usize..][..3]);
        let (mut error, mut largest) = (0.0_f64, f64::MIN_POSITIVE);
        for (found, expected) in found.zip(expected.as_flattened()) {
            error = error.max((f64::from(*found) - expected).abs());
            largest = largest.max(*expected);
        }
        Ok(error / largest)
    }
}

/// Unit values of a light at some pixels, from the encoded pixels and modulations that devices have.
fn exact_pixels(proxy: &Proxy, pixels: &[u32], light: &LightParams) -> Vec<[f64; 3]> {
    let info = proxy.info();
    let modulation: Vec<f64> = proxy.modulation(light).into_iter().map(f64::from).collect();
    let params = seen_values(light, &info.normalisation).map(f64::from);
    let scale = f64::from(info.output_scale.of(light).0);
    let parts = proxy.parts();
    let of_pixel = |&pixel: &u32| {
        let row: Vec<f64> = proxy.encoded().pixel(pixel as usize).map(f64::from).collect();
        let surface = &row[parts.pixel_rows - SURFACE..];
        let seen = features(info.kind.form(), &params, &surface_of(surface));
        let values = parts.outputs(&row, &seen, &modulation);
        let factor = |channel: usize| if parts.fast { surface[FACTOR + channel] } else { 1.0 };
        std::array::from_fn(|channel| scale * (values[channel] * factor(channel)).max(0.0))
    };
    pixels.par_iter().map(of_pixel).collect()
}

fn surface_of(rows: &[f64]) -> PixelSurface<f64> {
    let vector = |first: usize| [rows[first], rows[first + 1], rows[first + 2]];
    PixelSurface { position: vector(0), normal: vector(3), mirror: vector(6) }
}

impl Parts<'_> {
    /// Outputs from an encoded pixel, the features that it sees, and scale and shift of each layer: before factor and
    /// scale of outputs.
    fn outputs(&self, row: &[f64], features: &[f64; FEATURES], modulation: &[f64]) -> [f64; 3] {
        let width = self.first.rows;
        let mut layers = modulation.chunks_exact(2 * width).map(|layer| layer.split_at(width));
        let lit = |values: &[f64], (scale, shift): (&[f64], &[f64])| -> Vec<f64> {
            values.iter().zip(scale).zip(shift).map(|((value, scale), shift)| scale * value + shift).collect()
        };
        let mut next = |values: &[f64]| layers.next().map_or_else(Vec::new, |layer| lit(values, layer));
        let mut x = if self.fast {
            let trunk = next(&row[..width]);
            trunk.iter().zip(self.first.times(features)).map(|(trunk, seen)| trunk + seen).collect()
        } else {
            next(&self.first.times(&row[..self.first_inputs]))
        };
        for matrix in &self.hidden {
            x.iter_mut().for_each(|value| *value = value.max(0.0));
            x = next(&matrix.times(&x));
        }
        x.iter_mut().for_each(|value| *value = value.max(0.0));
        let sums = self.output.times(&x);
        std::array::from_fn(|channel| sums[channel] + f64::from(self.output_bias[channel]))
    }
}

impl Matrix<'_> {
    /// Product with a vector that has no more values than there are columns.
    fn times(&self, x: &[f64]) -> Vec<f64> {
        let row = |row: usize| x.iter().enumerate().map(|(col, x)| f64::from(self.at(row, col)) * x).sum();
        (0..self.rows).map(row).collect()
    }
}

impl Real for f64 {
    fn constant(x: f32) -> Self {
        Self::from(x)
    }
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    fn ramp(self) -> Self {
        self.max(0.0)
    }
    fn ln(self) -> Self {
        self.ln()
    }
}
