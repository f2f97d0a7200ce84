use relume_gpu::{Binding, Buffer, Commands, Gpu, Kernel};

use super::proxy::{GpuProxy, SharedBuffers, grow};
use crate::proxy::check_length;
use crate::{LightParams, ProxyError};

/// Quads of a layer that each invocation keeps (`KEPT` in `light_gradient.wgsl`).
const KEPT: usize = 16;
/// Values that come after those of the layers: by nine parameters and the radiance.
const LAST: usize = 12;

/// Kernels that gradients need besides those of inference.
#[derive(Debug)]
pub(super) struct GradientKernels {
    gradient: Kernel,
    add_up: Kernel,
    kept: Buffer<f32>,
    sums: Buffer<f32>,
}

/// Gradient of a loss by one light.
#[derive(Clone, Debug, PartialEq)]
pub struct LightGradient {
    /// Derivatives by the parameters, in the order of [`LightParams::as_slice`].
    pub params: Vec<f32>,
    /// Derivatives by the radiance.
    pub radiance: [f32; 3],
}

/// Arguments of `light_gradient`.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct GradientArguments {
    count: u32,
    groups: u32,
    lights: u32,
}

/// Arguments of `light_sums`.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct LightSumArguments {
    groups: u32,
    lights: u32,
    first: u32,
}

impl GpuProxy {
    /// Gradient of a loss by the light's parameters, as [`crate::Proxy::backward`].
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`], [`ProxyError::Length`], [`ProxyError::PixelOutside`] or [`ProxyError::Gpu`].
    pub fn backward(
        &self,
        pixels: &[u32],
        light: &LightParams,
        d_out: &[[f32; 3]],
    ) -> Result<Vec<f32>, ProxyError> {
        self.proxy().check_pixels(pixels)?;
        check_length("d_out", pixels.len(), d_out.len())?;
        let lights = [(*light, [1.0; 3])];
        let shared = &mut *self.shared();
        self.write_lights(shared, &lights)?;
        let batch = self.batch(1);
        let results = self.gpu().zeros("gradients by lights", self.gradient_len())?;
        for (pixels, d_out) in pixels.chunks(batch).zip(d_out.chunks(batch)) {
            let listed = self.gpu().buffer_of("pixels of a proxy", pixels)?;
            let d_picture = self.gpu().buffer_of("gradient by a picture", d_out)?;
            let mut commands = self.gpu().commands("light gradient");
            self.add_pixels(&mut commands, shared, listed.whole(), pixels.len())?;
            self.add_gradients(&mut commands, shared, 1, pixels.len(), d_picture.whole(), (&results, 0))?;
            commands.submit()?;
        }
        let values = self.gpu().read(&results, 0..self.gradient_len())?;
        Ok(self.light_gradient(&lights[0], &values).params)
    }

    /// Values of a light's gradient on the device.
    pub(super) fn gradient_len(&self) -> usize {
        2 * self.network().width * (self.network().hidden + 1) + LAST
    }

    /// Appends the gradient by `lights` lights, which are in place, at the `count` collected pixels; adds
    /// [`GpuProxy::gradient_len`] values of each to those in `results`, from this one on.
    pub(super) fn add_gradients(
        &self,
        commands: &mut Commands<'_>,
        shared: &mut SharedBuffers,
        lights: usize,
        count: usize,
        d_picture: Binding<'_>,
        (results, first): (&Buffer<f32>, usize),
    ) -> Result<(), ProxyError> {
        let layers = self.network().hidden + 1;
        let kept = 4 * KEPT * layers * self.threads();
        let groups = count.div_ceil(self.tile()).min((self.max_kept / (4 * kept * lights)).max(1));
        let sums = 4 * (4 * layers + 3) * self.threads();
        let kernels = GradientKernels::of(&mut shared.gradient, self)?;
        grow(self.gpu(), &mut kernels.kept, kept * groups * lights)?;
        grow(self.gpu(), &mut kernels.sums, sums * groups * lights)?;
        commands.clear(&kernels.sums);
        let inputs = self.inputs(&shared.lights, &shared.collected);
        let buffers: Vec<Binding<'_>> =
            inputs.into_iter().chain([d_picture, kernels.kept.whole(), kernels.sums.whole()]).collect();
        let (lights, groups, first) = (lights as u32, groups as u32, first as u32);
        let arguments = GradientArguments { count: count as u32, groups, lights };
        commands.run(&kernels.gradient.bind(&buffers)?, lights * groups, bytemuck::bytes_of(&arguments));
        let bound = kernels.add_up.bind(&[kernels.sums.whole(), results.whole()])?;
        let quads = (self.gradient_len() / 4) as u32;
        commands.run(
            &bound,
            lights * quads,
            bytemuck::bytes_of(&LightSumArguments { groups, lights, first }),
        );
        Ok(())
    }

    /// Gradient from the values of a light in `results`; its shape's gradient goes through modulation, features and
    /// output scale.
    pub(super) fn light_gradient(
        &self,
        (light, radiance): &(LightParams, [f32; 3]),
        values: &[f32],
    ) -> LightGradient {
        let (rows, last) = values.split_at(values.len() - LAST);
        let true_width = self.network().true_width;
        let d_modulation: Vec<f32> =
            rows.chunks_exact(self.network().width).flat_map(|row| &row[..true_width]).copied().collect();
        let d_radiance = [last[9], last[10], last[11]];
        let through_network = self.proxy().light_gradient(light, &d_modulation, &last[..9]);
        let (scale, d_scale) = self.proxy().info().output_scale.of(light);
        let by_scale = (0..3).map(|c| d_radiance[c] * radiance[c]).sum::<f32>() / scale;
        let params = light.as_slice().iter().enumerate();
        let params = params.map(|(i, _)| through_network[i] + by_scale * d_scale[i]).collect();
        LightGradient { params, radiance: d_radiance }
    }
}

impl GradientKernels {
    /// Compiled on first use: relighting does without.
    pub fn of<'a>(kernels: &'a mut Option<Self>, proxy: &GpuProxy) -> Result<&'a mut Self, ProxyError> {
        match kernels {
            Some(kernels) => Ok(kernels),
            none => Ok(none.insert(Self::new(proxy)?)),
        }
    }

    fn new(proxy: &GpuProxy) -> Result<Self, ProxyError> {
        let gpu: &Gpu = proxy.gpu();
        let row_blocks = proxy.network().width / 8;
        let sizes = [
            ("LAYERS", proxy.network().hidden as u32 + 1),
            ("PIXEL_BLOCKS", (proxy.threads() / row_blocks) as u32),
            ("ROW_BLOCKS", row_blocks as u32),
        ];
        Ok(Self {
            gradient: gpu.kernel("proxy/light_gradient", "light_gradient", &proxy.constants())?,
            add_up: gpu.kernel("proxy/light_sums", "light_sums", &sizes)?,
            kept: gpu.zeros("activations of a proxy", 1)?,
            sums: gpu.zeros("gradients of a proxy", 1)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_have_the_layout_of_their_wgsl_twins() {
        relume_gpu::assert_mirror!(GradientArguments as "proxy/light_gradient", "Arguments", {
            count, groups, lights,
        });
        relume_gpu::assert_mirror!(LightSumArguments as "proxy/light_sums", "Arguments", { groups, lights, first });
    }
}
