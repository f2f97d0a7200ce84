use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use relume_gpu::{Binding, Bound, Buffer, Commands, Gpu, GpuError, GpuImage, Kernel};
use relume_image::Image;

use super::DeviceNetwork;
use super::gradient::GradientKernels;
use super::matrices::ByMatrices;
use crate::analytic::seen_values;
use crate::proxy::check_length;
use crate::simd::LANES;
use crate::{LightKind, LightParams, Proxy, ProxyError};

/// Workgroup memory that kernels count on, bytes: what every card has, and small enough for several workgroups at a time.
const WORKGROUP_MEMORY: usize = 32 << 10;
/// Most pixels of a tile; more would leave cards idle at the end of an image.
const MAX_TILE: usize = PART_PIXELS;

/// Largest buffer of encoded pixels: larger ones are harder to find room for.
const PART_BYTES: u64 = 1 << 30;
/// Pixels that parts of an image come in: whole tiles, and images that start where bound parts of a buffer may.
const PART_PIXELS: usize = 256;
/// Most bytes of encoded pixels that are collected from a list at a time.
pub(super) const MAX_COLLECTED: u64 = 128 << 20;

/// Room for what as many workgroups keep as run at the same time on the largest cards, and for a buffer of any.
const MAX_KEPT: usize = 128 << 20;

/// A [`Proxy`] on a GPU: its weights, and all that is known of its pixels without a light.
#[derive(Debug)]
pub struct GpuProxy {
    gpu: Arc<Gpu>,
    proxy: Proxy,
    network: DeviceNetwork,
    /// Pixels of a tile.
    tile: usize,
    weights: Buffer<f32>,
    /// The image in runs of pixels that each fit a buffer.
    pub(super) parts: Vec<EncodedPixels>,
    infer: Kernel,
    collect: Kernel,
    /// Faster than `infer`, where the device can.
    matrices: Option<ByMatrices>,
    /// Most bytes of encoded pixels that are collected from a list at a time.
    pub(super) max_collected: u64,
    /// Most bytes that workgroups keep of the way forward while they make gradients.
    pub(super) max_kept: usize,
    /// Buffers that calls share, so that one at a time may write and submit.
    shared: Mutex<SharedBuffers>,
}

/// Encoded pixels that follow each other in the image.
#[derive(Debug)]
pub(super) struct EncodedPixels {
    pixels: Range<usize>,
    encoded: Buffer<f32>,
}

/// Buffers that calls share. They grow as asked.
#[derive(Debug)]
pub(super) struct SharedBuffers {
    pub lights: Buffer<f32>,
    /// Encoded pixels of a list, in its order.
    pub collected: Buffer<f32>,
    /// `[light][pixel]` RGB.
    pub units: Buffer<f32>,
    pub gradient: Option<GradientKernels>,
}

/// Arguments of `collect`.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct CollectArguments {
    count: u32,
    first: u32,
    end: u32,
}

/// Arguments of `infer`.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(C)]
struct InferArguments {
    count: u32,
    lights: u32,
}

impl GpuProxy {
    /// Brings a proxy to a device.
    ///
    /// # Errors
    /// [`ProxyError::Gpu`] if it does not fit.
    pub fn new(gpu: Arc<Gpu>, proxy: &Proxy) -> Result<Self, ProxyError> {
        let bytes = gpu.limits().buffer.min(PART_BYTES);
        Self::in_parts(gpu, proxy, bytes)
    }

    /// [`GpuProxy::new`] with at most so many bytes of encoded pixels in a buffer.
    pub(super) fn in_parts(gpu: Arc<Gpu>, proxy: &Proxy, bytes: u64) -> Result<Self, ProxyError> {
        let network = proxy.device_network();
        let limit = gpu.limits().workgroup_memory.min(WORKGROUP_MEMORY as u32) as usize;
        let rows = rows(&network);
        let tile = (limit / (4 * rows)).min(MAX_TILE);
        if tile < 8 {
            let what = format!("a network of {} neurons a layer", network.width);
            return Err(GpuError::TooWide { what }.into());
        }
        let tile = 1 << tile.ilog2();
        let kind = proxy.info().kind;
        let shared = SharedBuffers {
            lights: gpu.zeros("light of a proxy", light_len(&network))?,
            collected: gpu.zeros("collected pixels", 1)?,
            units: gpu.zeros("unit image", 3)?,
            gradient: None,
        };
        let mut on_device = Self {
            weights: gpu.buffer_of("weights of a proxy", &network.weights)?,
            parts: parts(&gpu, proxy, network.pixel_rows, bytes)?,
            infer: gpu.kernel("proxy/infer", "infer", &constants(&network, tile, kind))?,
            collect: gpu.kernel("proxy/collect", "collect", &[("PIXEL_ROWS", network.pixel_rows as u32)])?,
            matrices: None,
            max_collected: MAX_COLLECTED.min(gpu.limits().buffer),
            max_kept: MAX_KEPT,
            shared: Mutex::new(shared),
            proxy: proxy.clone(),
            network,
            tile,
            gpu,
        };
        on_device.matrices = ByMatrices::tested(&on_device)?;
        Ok(on_device)
    }

    /// The proxy that it was made of.
    pub fn proxy(&self) -> &Proxy {
        &self.proxy
    }

    /// The unit image of a light, as [`Proxy::unit_image`]. The error is some millionths of the largest value; where
    /// [`GpuProxy::by_matrices`], less than 2 % in root mean square, which was measured for one light when this was made.
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`], or [`ProxyError::Gpu`].
    pub fn unit_image(&self, light: &LightParams) -> Result<Image, ProxyError> {
        let [width, height] = self.proxy.info().image;
        let data = self.whole_image(light, self.matrices.as_ref())?;
        Ok(Image { width, height, channels: 3, data })
    }

    /// All pixels, by matrices or by the plain kernel.
    pub(super) fn whole_image(
        &self,
        light: &LightParams,
        matrices: Option<&ByMatrices>,
    ) -> Result<Vec<f32>, ProxyError> {
        let len = 3 * self.proxy.features().pixel_count();
        let shared = &mut *self.shared();
        grow(&self.gpu, &mut shared.units, len)?;
        self.write_lights(shared, &[(*light, [1.0; 3])])?;
        let mut commands = self.gpu.commands("unit image");
        self.add_whole(&mut commands, matrices, &shared.lights, &shared.units)?;
        commands.submit()?;
        Ok(self.gpu.read(&shared.units, 0..len)?)
    }

    /// [`GpuProxy::unit_image`] that stays on the device. Does not wait for it.
    ///
    /// # Errors
    /// See [`GpuProxy::unit_image`].
    pub fn gpu_image(&self, light: &LightParams) -> Result<GpuImage, ProxyError> {
        let [width, height] = self.proxy.info().image;
        let image = GpuImage::black(&self.gpu, width, height)?;
        let shared = &mut *self.shared();
        self.write_lights(shared, &[(*light, [1.0; 3])])?;
        let mut commands = self.gpu.commands("unit image");
        self.add_whole(&mut commands, self.matrices.as_ref(), &shared.lights, image.values())?;
        commands.submit()?;
        Ok(image)
    }

    /// The unit image of a light at some pixels, as [`Proxy::forward_pixels`].
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`], [`ProxyError::Length`], [`ProxyError::PixelOutside`] or [`ProxyError::Gpu`].
    pub fn forward_pixels(
        &self,
        pixels: &[u32],
        light: &LightParams,
        out: &mut [[f32; 3]],
    ) -> Result<(), ProxyError> {
        self.proxy.check_pixels(pixels)?;
        check_length("out", pixels.len(), out.len())?;
        let shared = &mut *self.shared();
        self.write_lights(shared, &[(*light, [1.0; 3])])?;
        let batch = self.batch(1);
        for (pixels, out) in pixels.chunks(batch).zip(out.chunks_mut(batch)) {
            grow(&self.gpu, &mut shared.units, 3 * pixels.len())?;
            let mut commands = self.gpu.commands("pixels of a proxy");
            let listed = self.gpu.buffer_of("pixels of a proxy", pixels)?;
            self.add_pixels(&mut commands, shared, listed.whole(), pixels.len())?;
            self.add_units(&mut commands, shared, 1, pixels.len())?;
            commands.submit()?;
            self.gpu.read_into(&shared.units, 0, out.as_flattened_mut())?;
        }
        Ok(())
    }

    fn add_whole(
        &self,
        commands: &mut Commands<'_>,
        matrices: Option<&ByMatrices>,
        lights: &Buffer<f32>,
        out: &Buffer<f32>,
    ) -> Result<(), ProxyError> {
        let (kernel, weights, tile) = match matrices {
            Some(matrices) => (&matrices.kernel, matrices.weights.whole(), matrices.tile),
            None => (&self.infer, self.weights.whole(), self.tile),
        };
        for EncodedPixels { pixels, encoded } in &self.parts {
            let out = out.part(3 * pixels.start..3 * pixels.end);
            let bound = kernel.bind(&[weights, encoded.whole(), lights.whole(), out])?;
            add_inference(commands, &bound, tile, 1, pixels.len());
        }
        Ok(())
    }

    /// True if unit images are made with matrices of 16-bit floats, which the device multiplies at once.
    pub fn by_matrices(&self) -> bool {
        self.matrices.is_some()
    }

    /// The kernel by matrices, or none for the plain one; nothing where there is no such kernel.
    pub(super) fn matrices_or_plain(&self, by_matrices: bool) -> Option<Option<&ByMatrices>> {
        if by_matrices { self.matrices.as_ref().map(Some) } else { Some(None) }
    }

    /// Bytes that making a unit image reads and writes at least: what is known of the pixels, and the image.
    pub fn image_bytes(&self) -> usize {
        self.proxy.features().pixel_count() * 4 * (self.network.pixel_rows + 3)
    }

    /// Appends the kernel that makes a unit image, by matrices or not, and nothing that copies the image; false where there is
    /// no such kernel. For measuring it.
    ///
    /// # Errors
    /// If there is no room for the image, or the device was lost.
    pub fn add_unit_image(
        &self,
        commands: &mut Commands<'_>,
        light: &LightParams,
        by_matrices: bool,
    ) -> Result<bool, ProxyError> {
        let Some(matrices) = self.matrices_or_plain(by_matrices) else { return Ok(false) };
        let shared = &mut *self.shared();
        grow(&self.gpu, &mut shared.units, 3 * self.proxy.features().pixel_count())?;
        self.write_lights(shared, &[(*light, [1.0; 3])])?;
        self.add_whole(commands, matrices, &shared.lights, &shared.units)?;
        Ok(true)
    }

    /// Listed pixels that may be worked on together for so many lights: what is collected of them, and their unit values, fit
    /// a buffer.
    pub(super) fn batch(&self, lights: usize) -> usize {
        let values = self.network.pixel_rows.max(3 * lights);
        ((self.max_collected / (4 * values as u64)) as usize & !31).max(32)
    }

    /// Appends what brings the encoded values of so many listed pixels together.
    pub(super) fn add_pixels(
        &self,
        commands: &mut Commands<'_>,
        shared: &mut SharedBuffers,
        pixels: Binding<'_>,
        count: usize,
    ) -> Result<(), ProxyError> {
        let values = count.next_multiple_of(32) * self.network.pixel_rows;
        grow(&self.gpu, &mut shared.collected, values)?;
        for EncodedPixels { pixels: of_part, encoded } in &self.parts {
            let bound = self.collect.bind(&[encoded.whole(), pixels, shared.collected.whole()])?;
            let (first, end) = (of_part.start as u32, of_part.end as u32);
            let arguments = CollectArguments { count: count as u32, first, end };
            commands.run(&bound, values.div_ceil(64) as u32, bytemuck::bytes_of(&arguments));
        }
        Ok(())
    }

    /// Appends the unit values of lights that are in place at the collected pixels.
    pub(super) fn add_units(
        &self,
        commands: &mut Commands<'_>,
        shared: &SharedBuffers,
        lights: usize,
        count: usize,
    ) -> Result<(), ProxyError> {
        let [weights, encoded, lit] = self.inputs(&shared.lights, &shared.collected);
        let bound = self.infer.bind(&[weights, encoded, lit, shared.units.whole()])?;
        add_inference(commands, &bound, self.tile, lights, count);
        Ok(())
    }

    /// The first buffers of every kernel of a network.
    pub(super) fn inputs<'a>(
        &'a self,
        lights: &'a Buffer<f32>,
        encoded: &'a Buffer<f32>,
    ) -> [Binding<'a>; 3] {
        [self.weights.whole(), encoded.whole(), lights.whole()]
    }

    pub(super) fn write_lights(
        &self,
        shared: &mut SharedBuffers,
        lights: &[(LightParams, [f32; 3])],
    ) -> Result<(), ProxyError> {
        lights.iter().try_for_each(|(light, _)| self.proxy.check_kind(light))?;
        let values: Vec<f32> = lights.iter().flat_map(|light| self.light_values(light)).collect();
        grow(&self.gpu, &mut shared.lights, values.len())?;
        self.gpu.write(&shared.lights, 0, &values);
        Ok(())
    }

    /// A light and its radiance as `network.wgsl` reads them.
    fn light_values(&self, (light, radiance): &(LightParams, [f32; 3])) -> Vec<f32> {
        let info = self.proxy.info();
        let mut values = Vec::with_capacity(self.light_len());
        for row in self.proxy.modulation(light).chunks_exact(self.network.true_width) {
            values.extend_from_slice(row);
            values.resize(values.len().next_multiple_of(self.network.width), 0.0);
        }
        let params = seen_values(light, &info.normalisation);
        for (vector, last) in params.chunks_exact(3).zip([info.output_scale.of(light).0, 0.0, 0.0]) {
            values.extend_from_slice(vector);
            values.push(last);
        }
        values.extend_from_slice(radiance);
        values.push(0.0);
        values
    }

    /// Device of the proxy.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    pub(super) fn network(&self) -> &DeviceNetwork {
        &self.network
    }

    pub(super) fn tile(&self) -> usize {
        self.tile
    }

    /// Invocations of a workgroup: each has a block of 8 by 8.
    pub(super) fn threads(&self) -> usize {
        self.network.width / 8 * (self.tile / 8)
    }

    /// Values of a light.
    pub(super) fn light_len(&self) -> usize {
        light_len(&self.network)
    }

    /// Constants of the kernels.
    pub(super) fn constants(&self) -> [(&'static str, u32); 7] {
        constants(&self.network, self.tile, self.proxy.info().kind)
    }

    pub(super) fn shared(&self) -> MutexGuard<'_, SharedBuffers> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The encoded pixels of a proxy in buffers of at most so many bytes, or of as few pixels as go together.
fn parts(gpu: &Gpu, proxy: &Proxy, rows: usize, bytes: u64) -> Result<Vec<EncodedPixels>, GpuError> {
    let most = ((bytes / (4 * rows as u64)) as usize / PART_PIXELS * PART_PIXELS).max(PART_PIXELS);
    let count = proxy.features().pixel_count();
    let part = |first: usize| {
        let pixels = first..count.min(first + most);
        let values = proxy.encoded().tiles(first / LANES..pixels.end.div_ceil(LANES));
        Ok(EncodedPixels { pixels, encoded: gpu.buffer_of("encoded pixels", &values)? })
    };
    (0..count).step_by(most).map(part).collect()
}

fn add_inference(commands: &mut Commands<'_>, bound: &Bound, tile: usize, lights: usize, count: usize) {
    let arguments = InferArguments { count: count as u32, lights: lights as u32 };
    commands.run(bound, (lights * count.div_ceil(tile)) as u32, bytemuck::bytes_of(&arguments));
}

/// Rows of the activations in workgroup memory: the widest layer or input.
fn rows(network: &DeviceNetwork) -> usize {
    network.width.max(network.first_inputs())
}

/// Values of a light.
fn light_len(network: &DeviceNetwork) -> usize {
    2 * network.width * (network.hidden + 1) + 16
}

fn constants(network: &DeviceNetwork, tile: usize, kind: LightKind) -> [(&'static str, u32); 7] {
    [
        ("WIDTH", network.width as u32),
        ("ROWS", rows(network) as u32),
        ("PIXELS", tile as u32),
        ("FAST", u32::from(network.fast)),
        ("HIDDEN", network.hidden as u32),
        ("PIXEL_ROWS", network.pixel_rows as u32),
        ("FORM", kind.form() as u32),
    ]
}

/// Makes a buffer at least this long; what was in it is lost.
pub(super) fn grow<T: bytemuck::NoUninit>(
    gpu: &Gpu,
    buffer: &mut Buffer<T>,
    len: usize,
) -> Result<(), GpuError> {
    if buffer.len() < len {
        *buffer = gpu.zeros("proxy", len)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_have_the_layout_of_their_wgsl_twins() {
        relume_gpu::assert_mirror!(CollectArguments as "proxy/collect", "Arguments", { count, first, end });
        relume_gpu::assert_mirror!(InferArguments as "proxy/infer", "Arguments", { count, lights });
        relume_gpu::assert_mirror!(InferArguments as "proxy/matrices", "Arguments", { count, lights });
    }
}
