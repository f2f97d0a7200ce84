use glam::Vec3;
use rayon::prelude::*;
use relume_gather::{DenoiseQuality, Gather, GatherError, GpuGather, Half, PreparedLight, Scratch};
use relume_gpu::Gpu;
use relume_image::Image;
use relume_proxy::{PixelQueries, ProxyError, Rng, TargetSource};
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

    fn pixel_targets(
        &self,
        queries: &PixelQueries<'_>,
        lights: &[PreparedLight],
        half: Half,
        out: &mut [[f32; 3]],
    ) -> Result<(), GatherError> {
        let pixels = self.gpu.buffer_of("pixels of targets", queries.pixels)?;
        let lights = self.gather.lights(lights)?;
        let values = self.gpu.zeros("targets", 3 * out.len())?;
        self.gather.pixel_targets(&pixels, &lights, queries.lights_per_pixel as u32, half, &values)?;
        let values = self.gpu.read(&values, 0..3 * out.len())?;
        out.as_flattened_mut().copy_from_slice(&values);
        Ok(())
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

    /// The denoiser.
    pub fn denoise(&self) -> &'a Denoise {
        self.denoise
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
        if let Some(gpu) = self.gpu.filter(|gpu| gpu.gather.is_resident()) {
            let lights: Vec<PreparedLight> =
                queries.lights.par_iter().map(|shape| self.prepare(shape)).collect::<Result<_, _>>()?;
            return gpu.pixel_targets(queries, &lights, self.half, out).map_err(ProxyError::targets);
        }
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
}
