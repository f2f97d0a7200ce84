use glam::Vec3;
use rayon::prelude::*;
use relume_gather::{
    DenoiseQuality, Emitter, Gather, GatherError, GatherScratch, GpuGather, PreparedLight, SampleSplit,
};
use relume_gpu::{Buffer, Gpu, GpuError};
use relume_image::Image;
use relume_proxy::{DeviceTargets, GroupQueries, PixelQueries, ProxyError, Rng, TargetSource};
use relume_scene::{Light, LightShape};
use relume_trace::ConnectScratch;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::device::connections::Connections;
use crate::relight::denoise::Denoise;
use crate::train::connected::ConnectedPixels;

/// Targets of a training, gathered from a dump (paper, section 4.4).
pub struct DumpTargets<'a> {
    gather: &'a Gather,
    split: SampleSplit,
    bounds: (Vec3, Vec3),
    denoise: &'a Denoise,
    gpu: Option<&'a GpuTargets>,
    /// Connections of single pixels.
    connected_pixels: Option<&'a ConnectedPixels>,
    /// Connections of whole images, and the number of their levels.
    connections: Option<(&'a Connections, usize)>,
}

/// A dump on a GPU, for targets.
pub struct GpuTargets {
    gpu: Arc<Gpu>,
    gather: GpuGather,
    gathers_pixels: bool,
    lacked_room: AtomicBool,
}

impl GpuTargets {
    /// Brings a dump there.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn new(gpu: &Arc<Gpu>, gather: &Gather) -> Result<Self, GatherError> {
        let gather = GpuGather::new(Arc::clone(gpu), gather)?;
        let gathers_pixels = gather.gathers_pixels();
        Ok(Self { gpu: Arc::clone(gpu), gather, gathers_pixels, lacked_room: false.into() })
    }

    /// True if single pixels are gathered there: the whole dump stays, or there was room to copy parts.
    pub fn gathers_pixels(&self) -> bool {
        self.gathers_pixels
    }

    /// True if the CPU had to gather single pixels for lack of room.
    pub fn lacked_room(&self) -> bool {
        self.lacked_room.load(Ordering::Relaxed)
    }

    /// Bytes of the dump that were copied for single pixels, since it does not stay there.
    pub fn copied_bytes(&self) -> u64 {
        self.gather.copied_bytes()
    }

    /// Gathers pixels under lights that neighbours share.
    fn pixel_targets(
        &self,
        pixels: &[u32],
        lights: &[PreparedLight],
        lights_per_pixel: usize,
        split: SampleSplit,
        out: &Buffer<f32>,
    ) -> Result<(), GatherError> {
        let lights = self.gather.lights(lights)?;
        self.gather.pixel_targets(pixels, &lights, lights_per_pixel as u32, split, out)
    }
}

/// Working memory of single pixels, one per thread.
#[derive(Default)]
struct PixelWork {
    lights: Vec<PreparedLight>,
    emitters: Vec<Option<Emitter>>,
    gather: GatherScratch,
    connect: ConnectScratch,
}

impl<'a> DumpTargets<'a> {
    /// Targets from some of the paths of each pixel. `bounds` is the box of visible positions.
    pub fn new(gather: &'a Gather, split: SampleSplit, bounds: (Vec3, Vec3), denoise: &'a Denoise) -> Self {
        Self { gather, split, bounds, denoise, gpu: None, connected_pixels: None, connections: None }
    }

    /// Sets connections of single pixels, which the CPU then gathers.
    #[must_use]
    pub(super) fn with_pixels_connected(self, connected_pixels: Option<&'a ConnectedPixels>) -> Self {
        Self { connected_pixels, ..self }
    }

    /// Sets connections of whole images, by so many levels.
    #[must_use]
    pub(crate) fn with_connections(self, connections: Option<(&'a Connections, usize)>) -> Self {
        Self { connections, ..self }
    }

    /// Sets a GPU that gathers, if there is one.
    #[must_use]
    pub fn on(self, gpu: Option<&'a GpuTargets>) -> Self {
        Self { gpu, ..self }
    }

    /// Targets from other paths of each pixel.
    #[must_use]
    pub fn of_split(&self, split: SampleSplit) -> Self {
        Self { split, ..*self }
    }

    /// The denoiser.
    pub fn denoise(&self) -> &'a Denoise {
        self.denoise
    }

    /// The dump on the GPU, if single pixels are gathered there.
    fn for_pixels(&self) -> Option<&GpuTargets> {
        self.gpu.filter(|gpu| gpu.gathers_pixels && self.connected_pixels.is_none())
    }

    /// Targets that the GPU would have gathered for these queries, with lights prepared.
    fn gathered_here(&self, queries: &GroupQueries<'_>, lights: &[PreparedLight]) -> Vec<[f32; 3]> {
        let (count, group) = (queries.lights_per_pixel, queries.group);
        let mut values = vec![[0.0; 3]; queries.pixels.len() * count];
        let groups = values.par_chunks_mut(group * count).zip(queries.pixels.par_chunks(group));
        groups.zip(lights.par_chunks(count)).for_each_init(
            GatherScratch::default,
            |scratch, ((values, pixels), lights)| {
                for (pixel, values) in pixels.iter().zip(values.chunks_exact_mut(count)) {
                    let (x, y) = self.place(*pixel);
                    self.gather.pixel_into(x, y, lights, self.split, scratch, values);
                }
            },
        );
        values
    }

    /// Values of a pixel under some lights.
    fn pixel(
        &self,
        pixel: u32,
        shapes: &[LightShape],
        PixelWork { lights, emitters, gather, connect }: &mut PixelWork,
        values: &mut [[f32; 3]],
    ) -> Result<(), GatherError> {
        lights.clear();
        emitters.clear();
        for light in shapes.iter().map(|shape| Light::unit(*shape)) {
            let (crossed, connected) = match self.connected_pixels {
                Some(connections) => connections.prepare(self.gather, &light)?,
                None => (self.gather.prepare(&light)?, None),
            };
            lights.push(crossed);
            emitters.push(connected);
        }
        let (x, y) = self.place(pixel);
        self.gather.pixel_into(x, y, lights, self.split, gather, values);
        let Some(connections) = self.connected_pixels else { return Ok(()) };
        let place = self.gather.dump().locate(x, y);
        for ((value, shape), emitter) in values.iter_mut().zip(shapes).zip(emitters) {
            let Some(emitter) = emitter else { continue };
            let connected = connections.light(place, emitter, key(shape), connect);
            value.iter_mut().zip(connected).for_each(|(value, light)| *value += light);
        }
        Ok(())
    }

    fn prepare(&self, shape: &LightShape) -> Result<PreparedLight, ProxyError> {
        self.gather.prepare(&Light::unit(*shape)).map_err(ProxyError::targets)
    }

    fn place(&self, pixel: u32) -> (usize, usize) {
        let width = self.gather.dump().manifest().width;
        (pixel as usize % width, pixel as usize / width)
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
            PixelWork::default,
            |work, ((pixel, shapes), values)| {
                self.pixel(*pixel, shapes, work, values).map_err(ProxyError::targets)
            },
        )
    }

    fn images(&self, lights: &[LightShape], denoised: bool) -> Result<Vec<Image>, ProxyError> {
        let lights: Vec<Light> = lights.iter().map(|shape| Light::unit(*shape)).collect();
        let crossed = match self.connections {
            Some((connections, _)) => connections.crossed(self.gather, &lights),
            None => self.gather.prepare_all(&lights),
        };
        let crossed = crossed.map_err(ProxyError::targets)?;
        let mut images = match self.gpu {
            Some(gpu) => gpu.gather.unit_images(&crossed, self.split).map_err(ProxyError::targets)?,
            None => self.gather.unit_images(&crossed, self.split),
        };
        if let Some((connections, levels)) = self.connections {
            connections.prepare(levels);
            let emitters = connections.emitters(&lights).map_err(ProxyError::targets)?;
            let connected = connections.images(self.gather, &lights, &emitters, levels, &|| false);
            for (light, connected) in connected.into_iter().flatten() {
                images[light].add_scaled(&connected.image, &[1.0; 3]);
            }
        }
        if denoised {
            self.denoise.images(&mut images, DenoiseQuality::Fast).map_err(ProxyError::targets)?;
        }
        Ok(images)
    }

    fn on_device(&self) -> Option<&dyn DeviceTargets> {
        self.for_pixels().map(|_| self as &dyn DeviceTargets)
    }
}

/// Number of a light by its place, for random choices that depend on the light alone.
fn key(shape: &LightShape) -> u64 {
    let [x, y, z] = shape.center().unwrap_or_default().to_array().map(|x| u64::from(x.to_bits()));
    x ^ y.rotate_left(21) ^ z.rotate_left(42)
}

impl DeviceTargets for DumpTargets<'_> {
    fn pixel_targets(&self, queries: &GroupQueries<'_>, out: &Buffer<f32>) -> Result<(), ProxyError> {
        let gpu = self.for_pixels().ok_or_else(|| ProxyError::targets("the source is not on the device"))?;
        let lights: Vec<PreparedLight> =
            queries.lights.iter().map(|shape| self.prepare(shape)).collect::<Result<_, _>>()?;
        let count = queries.lights_per_pixel;
        match gpu.pixel_targets(queries.pixels, &lights, count, self.split, out) {
            Err(GatherError::Gpu(GpuError::OutOfMemory { .. })) => {
                gpu.lacked_room.store(true, Ordering::Relaxed);
                gpu.gpu.write(out, 0, self.gathered_here(queries, &lights).as_flattened());
                Ok(())
            }
            result => result.map_err(ProxyError::targets),
        }
    }
}
