use glam::Vec3;
use rayon::prelude::*;
use relume_gather::{DenoiseQuality, Gather, GatherError, GpuGather, Half, PreparedLight, Scratch};
use relume_gpu::{Buffer, Gpu};
use relume_image::Image;
use relume_proxy::{DeviceTargets, GroupQueries, PixelQueries, ProxyError, Rng, TargetSource};
use relume_scene::{Light, LightShape, LobeFactors};
use std::sync::Arc;

use crate::denoise::Denoise;

/// Targets of a training, gathered from a dump (paper, section 4.4).
pub struct DumpTargets<'a> {
    gather: &'a Gather,
    half: Half,
    bounds: (Vec3, Vec3),
    denoise: &'a Denoise,
    gpu: Option<&'a GpuTargets>,
}

/// A dump on a GPU, for targets.
pub struct GpuTargets {
    gpu: Arc<Gpu>,
    gather: GpuGather,
}

impl GpuTargets {
    /// Brings a dump there.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn new(gpu: &Arc<Gpu>, gather: &Gather) -> Result<Self, GatherError> {
        Ok(Self { gpu: Arc::clone(gpu), gather: GpuGather::new(Arc::clone(gpu), gather)? })
    }

    /// Whether all of the dump stays there: single pixels are not gathered from one that is streamed.
    pub fn is_resident(&self) -> bool {
        self.gather.is_resident()
    }

    /// Gathers pixels under lights that neighbours share.
    fn pixel_targets(
        &self,
        pixels: &[u32],
        lights: &[PreparedLight],
        lights_per_pixel: usize,
        half: Half,
        out: &Buffer<f32>,
    ) -> Result<(), GatherError> {
        let pixels = self.gpu.buffer_of("pixels of targets", pixels)?;
        let lights = self.gather.lights(lights)?;
        self.gather.pixel_targets(&pixels, &lights, lights_per_pixel as u32, half, out)
    }
}

impl<'a> DumpTargets<'a> {
    /// Targets from some of the paths of each pixel. `bounds` is the box of visible positions.
    pub fn new(gather: &'a Gather, half: Half, bounds: (Vec3, Vec3), denoise: &'a Denoise) -> Self {
        Self { gather, half, bounds, denoise, gpu: None }
    }

    /// Lets a GPU gather, if there is one.
    #[must_use]
    pub fn on(self, gpu: Option<&'a GpuTargets>) -> Self {
        Self { gpu, ..self }
    }

    /// The same from other paths of each pixel.
    #[must_use]
    pub fn of_half(&self, half: Half) -> Self {
        Self { half, ..*self }
    }

    /// The denoiser.
    pub fn denoise(&self) -> &'a Denoise {
        self.denoise
    }

    /// The dump on the GPU, if all of it stays there.
    fn resident(&self) -> Option<&GpuTargets> {
        self.gpu.filter(|gpu| gpu.is_resident())
    }

    fn prepare(&self, shape: &LightShape) -> Result<PreparedLight, ProxyError> {
        self.gather.prepare(&unit_light(shape)).map_err(ProxyError::targets)
    }

    fn place(&self, pixel: u32) -> (usize, usize) {
        let width = self.gather.dump().manifest().width;
        (pixel as usize % width, pixel as usize / width)
    }
}

/// The light that proxies learn: radiance 1, Blender's default ray visibility, all receivers.
pub(crate) fn unit_light(shape: &LightShape) -> Light {
    Light {
        name: String::new(),
        shape: *shape,
        radiance: [1.0; 3],
        lobes: LobeFactors::default(),
        receivers: None,
    }
}

impl TargetSource for DumpTargets<'_> {
    fn bounds(&self) -> (Vec3, Vec3) {
        self.bounds
    }

    fn segment_point(&self, pixel: u32, rng: &mut Rng) -> Option<Vec3> {
        let (x, y) = self.place(pixel);
        // Some segments end outside of every box; another one will do.
        const TRIES: usize = 8;
        (0..TRIES).find_map(|_| self.gather.segment_point(x, y, [rng.next_f32(), rng.next_f32()]))
    }

    fn pixel_targets(&self, queries: &PixelQueries<'_>, out: &mut [[f32; 3]]) -> Result<(), ProxyError> {
        let count = queries.lights_per_pixel;
        let pixels = queries.pixels.par_iter().zip(queries.lights.par_chunks_exact(count));
        pixels.zip(out.par_chunks_exact_mut(count)).try_for_each_init(
            || (Scratch::default(), Vec::with_capacity(count)),
            |(scratch, lights), ((pixel, shapes), values)| {
                lights.clear();
                for shape in shapes {
                    lights.push(self.prepare(shape)?);
                }
                let (x, y) = self.place(*pixel);
                self.gather.pixel_into(x, y, lights, self.half, scratch, values);
                Ok(())
            },
        )
    }

    fn images(&self, lights: &[LightShape], denoised: bool) -> Result<Vec<Image>, ProxyError> {
        let lights: Vec<PreparedLight> =
            lights.iter().map(|shape| self.prepare(shape)).collect::<Result<_, _>>()?;
        let mut images = match self.gpu {
            Some(gpu) => gpu.gather.unit_images(&lights, self.half).map_err(ProxyError::targets)?,
            None => self.gather.unit_images(&lights, self.half),
        };
        if denoised {
            self.denoise.images(&mut images, DenoiseQuality::Fast).map_err(ProxyError::targets)?;
        }
        Ok(images)
    }

    fn on_device(&self) -> Option<&dyn DeviceTargets> {
        self.resident().map(|_| self as &dyn DeviceTargets)
    }
}

impl DeviceTargets for DumpTargets<'_> {
    fn pixel_targets(&self, queries: &GroupQueries<'_>, out: &Buffer<f32>) -> Result<(), ProxyError> {
        let gpu = self.resident().ok_or_else(|| ProxyError::targets(GatherError::NotResident))?;
        let lights: Vec<PreparedLight> =
            queries.lights.iter().map(|shape| self.prepare(shape)).collect::<Result<_, _>>()?;
        let count = queries.lights_per_pixel;
        gpu.pixel_targets(queries.pixels, &lights, count, self.half, out).map_err(ProxyError::targets)
    }
}
