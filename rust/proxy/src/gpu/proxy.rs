use std::sync::{Arc, Mutex, PoisonError};

use relume_gpu::{Binding, Buffer, Gpu, GpuError, Kernel};
use relume_image::Image;

use super::DeviceNetwork;
use crate::analytic::scaled_params;
use crate::proxy::check_length;
use crate::{LightKind, LightParams, Proxy, ProxyError};

/// Workgroup memory that kernels count on, bytes: what every card has, and small enough for several workgroups at a time.
const WORKGROUP_MEMORY: usize = 32 << 10;
/// Most pixels of a tile; more would leave cards idle at the end of an image.
const MAX_TILE: usize = 256;

/// A [`Proxy`] on a GPU: its weights, and all that is known of its pixels without a light.
#[derive(Debug)]
pub struct GpuProxy {
    gpu: Arc<Gpu>,
    proxy: Proxy,
    network: DeviceNetwork,
    /// Pixels of a tile.
    tile: usize,
    weights: Buffer<f32>,
    encoded: Buffer<f32>,
    whole: Kernel,
    listed: Kernel,
    /// Stands for the list of pixels where all are asked for.
    no_list: Buffer<u32>,
    /// Buffers that calls share, so that one at a time may write and submit.
    shared: Mutex<Shared>,
}

/// Grows as asked.
#[derive(Debug)]
struct Shared {
    lights: Buffer<f32>,
    pixels: Buffer<u32>,
    units: Buffer<f32>,
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
        let network = proxy.device_network();
        let limit = gpu.limits().workgroup_memory.min(WORKGROUP_MEMORY as u32) as usize;
        let rows = rows(&network);
        let tile = (limit / (4 * rows)).min(MAX_TILE);
        if tile < 8 {
            let what = format!("a network of {} neurons a layer", network.width);
            return Err(GpuError::TooLarge { what, limit: 0 }.into());
        }
        let tile = 1 << tile.ilog2();
        let kernel = |listed: bool| {
            let quad = proxy.info().kind == LightKind::Quad;
            gpu.kernel("proxy/infer", "infer", &constants(&network, tile, quad, listed))
        };
        let shared = Shared {
            lights: gpu.zeros("light of a proxy", light_len(&network))?,
            pixels: gpu.zeros("pixels of a proxy", 1)?,
            units: gpu.zeros("unit image", 3)?,
        };
        Ok(Self {
            weights: gpu.buffer_of("weights of a proxy", &network.forward)?,
            encoded: gpu.buffer_of("encoded pixels", proxy.encoded())?,
            whole: kernel(false)?,
            listed: kernel(true)?,
            no_list: gpu.zeros("no list", 1)?,
            shared: Mutex::new(shared),
            proxy: proxy.clone(),
            network,
            tile,
            gpu,
        })
    }

    /// The proxy that it was made of.
    pub fn proxy(&self) -> &Proxy {
        &self.proxy
    }

    /// The unit image of a light, as [`Proxy::unit_image`].
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`], or [`ProxyError::Gpu`].
    pub fn unit_image(&self, light: &LightParams) -> Result<Image, ProxyError> {
        let [width, height] = self.proxy.info().image;
        let shared = &mut *self.shared();
        grow(&self.gpu, &mut shared.units, 3 * width * height)?;
        self.unit_into(shared, light, &shared.units)?;
        let data = self.gpu.read(&shared.units, 0..3 * width * height)?;
        Ok(Image { width, height, channels: 3, data })
    }

    /// The unit image of a light into a buffer of the device, row-major RGB. Does not wait for it.
    ///
    /// # Errors
    /// [`ProxyError::WrongKind`], [`ProxyError::Length`] or [`ProxyError::Gpu`].
    pub fn unit_buffer(&self, light: &LightParams, out: &Buffer<f32>) -> Result<(), ProxyError> {
        check_length("out", 3 * self.pixel_count(), out.len())?;
        self.unit_into(&self.shared(), light, out)
    }

    fn unit_into(&self, shared: &Shared, light: &LightParams, out: &Buffer<f32>) -> Result<(), ProxyError> {
        self.write_light(shared, light)?;
        self.run(&self.whole, shared, self.no_list.whole(), self.pixel_count(), out)
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
        grow(&self.gpu, &mut shared.pixels, pixels.len())?;
        grow(&self.gpu, &mut shared.units, 3 * pixels.len())?;
        self.gpu.write(&shared.pixels, 0, pixels);
        self.write_light(shared, light)?;
        self.run(&self.listed, shared, shared.pixels.whole(), pixels.len(), &shared.units)?;
        let values = self.gpu.read(&shared.units, 0..3 * pixels.len())?;
        out.as_flattened_mut().copy_from_slice(&values);
        Ok(())
    }

    fn run(
        &self,
        kernel: &Kernel,
        shared: &Shared,
        list: Binding<'_>,
        count: usize,
        out: &Buffer<f32>,
    ) -> Result<(), ProxyError> {
        let buffers = [self.weights.whole(), self.encoded.whole(), shared.lights.whole(), list, out.whole()];
        let bound = kernel.bind(&buffers)?;
        let mut commands = self.gpu.commands("proxy");
        let arguments = InferArguments { count: count as u32, lights: 1 };
        commands.run(&bound, count.div_ceil(self.tile) as u32, bytemuck::bytes_of(&arguments));
        Ok(commands.submit()?)
    }

    fn write_light(&self, shared: &Shared, light: &LightParams) -> Result<(), ProxyError> {
        self.proxy.check_kind(light)?;
        self.gpu.write(&shared.lights, 0, &self.light_values(light, [1.0; 3]));
        Ok(())
    }

    /// A light as `network.wgsl` reads it.
    fn light_values(&self, light: &LightParams, radiance: [f32; 3]) -> Vec<f32> {
        let info = self.proxy.info();
        let mut values = Vec::with_capacity(light_len(&self.network));
        for row in self.proxy.modulation(light).chunks_exact(self.network.true_width) {
            values.extend_from_slice(row);
            values.resize(values.len().next_multiple_of(self.network.width), 0.0);
        }
        let params = scaled_params(light, info.normalisation.center, info.normalisation.scale);
        for (vector, last) in params.chunks_exact(3).zip([info.output_scale.of(light).0, 0.0, 0.0]) {
            values.extend_from_slice(vector);
            values.push(last);
        }
        values.extend_from_slice(&radiance);
        values.push(0.0);
        values
    }

    fn pixel_count(&self) -> usize {
        self.proxy.features().pixel_count()
    }

    fn shared(&self) -> std::sync::MutexGuard<'_, Shared> {
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Rows of the activations in workgroup memory: the widest layer or input.
fn rows(network: &DeviceNetwork) -> usize {
    network.width.max(if network.fast { 12 } else { network.pixel_rows })
}

/// Values of a light.
fn light_len(network: &DeviceNetwork) -> usize {
    2 * network.width * (network.hidden + 1) + 16
}

fn constants(network: &DeviceNetwork, tile: usize, quad: bool, listed: bool) -> [(&'static str, u32); 8] {
    [
        ("WIDTH", network.width as u32),
        ("ROWS", rows(network) as u32),
        ("PIXELS", tile as u32),
        ("FAST", u32::from(network.fast)),
        ("HIDDEN", network.hidden as u32),
        ("PIXEL_ROWS", network.pixel_rows as u32),
        ("QUAD", u32::from(quad)),
        ("LISTED", u32::from(listed)),
    ]
}

/// Makes a buffer at least this long; what was in it is lost.
fn grow<T: bytemuck::NoUninit>(gpu: &Gpu, buffer: &mut Buffer<T>, len: usize) -> Result<(), GpuError> {
    if buffer.len() < len {
        *buffer = gpu.zeros("proxy", len)?;
    }
    Ok(())
}
