use relume_gpu::Buffer;

use super::gradient::{GradientKernels, LightGradient};
use super::proxy::{GpuProxy, grow};
use crate::proxy::check_length;
use crate::{LightParams, ProxyError};

/// Pixels of a workgroup of `compare.wgsl`.
const GROUP: usize = 64;

/// A picture to be matched, on the device of a proxy: steps of a light optimiser without pictures coming back.
#[derive(Debug)]
pub struct GpuComparison<'a> {
    proxy: &'a GpuProxy,
    base: Buffer<f32>,
    target: Buffer<f32>,
    exposure: f32,
}

/// Arguments of `compare`.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct CompareArguments {
    count: u32,
    lights: u32,
    exposure: f32,
    losses: u32,
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
    /// Mean over some pixels of the squared difference of the base with these lights, given with their radiances, to the
    /// target; and its gradient by each light.
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`], [`ProxyError::PixelOutside`] or [`ProxyError::Gpu`].
    pub fn gradient(
        &self,
        lights: &[(LightParams, [f32; 3])],
        pixels: &[u32],
    ) -> Result<(f64, Vec<LightGradient>), ProxyError> {
        let proxy = self.proxy;
        proxy.proxy().check_pixels(pixels)?;
        let count = pixels.len();
        let shared = &mut *proxy.shared();
        proxy.write_pixels(shared, pixels)?;
        proxy.write_lights(shared, lights)?;
        grow(proxy.gpu(), &mut shared.units, 3 * count * lights.len())?;
        let gradients = lights.len() * proxy.gradient_len();
        let groups = count.div_ceil(GROUP);
        let d_picture = proxy.gpu().zeros("gradient by a picture", 3 * count)?;
        let results = proxy.gpu().zeros("loss and gradients", gradients + groups)?;

        let mut commands = proxy.gpu().commands("light step");
        proxy.add_units(&mut commands, shared, lights.len(), count)?;
        let bound = GradientKernels::of(&mut shared.gradient, proxy)?.compare.bind(&[
            shared.lights.whole(),
            shared.pixels.whole(),
            shared.units.whole(),
            self.base.whole(),
            self.target.whole(),
            d_picture.whole(),
            results.whole(),
        ])?;
        let arguments = CompareArguments {
            count: count as u32,
            lights: lights.len() as u32,
            exposure: self.exposure,
            losses: gradients as u32,
        };
        commands.run(&bound, groups as u32, bytemuck::bytes_of(&arguments));
        proxy.add_gradients(&mut commands, shared, lights.len(), count, &d_picture, &results)?;
        commands.submit()?;
        let values = proxy.gpu().read(&results, 0..gradients + groups)?;
        let (by_light, losses) = values.split_at(gradients);
        let by_light = lights.iter().zip(by_light.chunks_exact(proxy.gradient_len()));
        let gradients = by_light.map(|(light, values)| proxy.light_gradient(light, values)).collect();
        Ok((losses.iter().map(|loss| f64::from(*loss)).sum(), gradients))
    }
}
