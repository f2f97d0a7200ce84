use relume_gpu::{Buffer, CompareArguments, CompareKernel};

use super::gradient::{GradientKernels, LightGradient};
use super::proxy::{GpuProxy, Shared, grow};
use crate::proxy::check_length;
use crate::{LightParams, ProxyError};

/// A picture to be matched, on the device of a proxy: steps of a light optimiser without pictures coming back.
#[derive(Debug)]
pub struct GpuComparison<'a> {
    proxy: &'a GpuProxy,
    base: Buffer<f32>,
    target: Buffer<f32>,
    exposure: f32,
}

impl GpuProxy {
    /// Prepares a target picture and what is there without the lights, both RGB, row-major, scene-linear; they are compared
    /// under Reinhard's curve after a multiplication with `exposure`.
    ///
    /// # Errors
    /// [`ProxyError::Length`] or [`ProxyError::Gpu`].
    pub fn comparison(
        &self,
        base: &[f32],
        target: &[f32],
        exposure: f32,
    ) -> Result<GpuComparison<'_>, ProxyError> {
        let len = 3 * self.proxy().features().pixel_count();
        check_length("base", len, base.len())?;
        check_length("target", len, target.len())?;
        Ok(GpuComparison {
            proxy: self,
            base: self.gpu().buffer_of("base picture", base)?,
            target: self.gpu().buffer_of("target picture", target)?,
            exposure,
        })
    }
}

impl GpuComparison<'_> {
    /// Sum over some pixels, each times its share, of the squared difference of the base with these lights, given with their
    /// radiances, to the target; and its gradient by each light.
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`], [`ProxyError::PixelOutside`], [`ProxyError::Length`] or [`ProxyError::Gpu`].
    pub fn gradient(
        &self,
        lights: &[(LightParams, [f32; 3])],
        pixels: &[u32],
        shares: &[f32],
    ) -> Result<(f64, Vec<LightGradient>), ProxyError> {
        let proxy = self.proxy;
        check_length("shares", pixels.len(), shares.len())?;
        proxy.proxy().check_pixels(pixels)?;
        let shared = &mut *proxy.shared();
        proxy.write_lights(shared, lights)?;
        let mut loss = 0.0;
        let mut sums = vec![0.0; lights.len() * proxy.gradient_len()];
        let batch = proxy.batch(lights.len());
        for (pixels, shares) in pixels.chunks(batch).zip(shares.chunks(batch)) {
            let values = self.sums(shared, lights.len(), pixels, shares)?;
            let (by_lights, losses) = values.split_at(sums.len());
            loss += losses.iter().map(|loss| f64::from(*loss)).sum::<f64>();
            sums.iter_mut().zip(by_lights).for_each(|(sum, value)| *sum += value);
        }
        let by_light = lights.iter().zip(sums.chunks_exact(proxy.gradient_len()));
        Ok((loss, by_light.map(|(light, values)| proxy.light_gradient(light, values)).collect()))
    }

    /// Of lights that are in place, at some pixels that have these shares in the loss: their values of the gradient, and
    /// then losses to be added up.
    fn sums(
        &self,
        shared: &mut Shared,
        lights: usize,
        pixels: &[u32],
        shares: &[f32],
    ) -> Result<Vec<f32>, ProxyError> {
        let (proxy, count) = (self.proxy, pixels.len());
        grow(proxy.gpu(), &mut shared.units, 3 * count * lights)?;
        let gradients = lights * proxy.gradient_len();
        let losses = CompareKernel::losses(count);
        let shares = proxy.gpu().buffer_of("shares of pixels", shares)?;
        let d_picture = proxy.gpu().zeros("gradient by a picture", 3 * count)?;
        let results = proxy.gpu().zeros("loss and gradients", gradients + losses)?;

        let mut commands = proxy.gpu().commands("light step");
        proxy.add_pixels(&mut commands, shared, pixels)?;
        proxy.add_units(&mut commands, shared, lights, count)?;
        let kernels = GradientKernels::of(&mut shared.gradient, proxy)?;
        let buffers = [
            shared.lights.whole(),
            shared.pixels.whole(),
            shared.units.whole(),
            self.base.whole(),
            self.target.whole(),
            shares.whole(),
            d_picture.whole(),
            results.whole(),
        ];
        let arguments = CompareArguments {
            count: count as u32,
            lights: lights as u32,
            exposure: self.exposure,
            losses: gradients as u32,
        };
        kernels.compare.add(&mut commands, &buffers, &arguments)?;
        proxy.add_gradients(&mut commands, shared, lights, count, &d_picture, &results)?;
        commands.submit()?;
        Ok(proxy.gpu().read(&results, 0..gradients + losses)?)
    }
}
