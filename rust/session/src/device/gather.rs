use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Once};

use relume_gather::{
    Emitter, Environment, Gather, GatherError, Goals, GpuGather, PreparedLight, SampleSplit, SoftCompared,
    SoftGather, UnitValues,
};
use relume_gpu::compare::StepTargets;
use relume_gpu::{Gpu, GpuError};
use relume_image::Image;
use relume_scene::Light;

use crate::device::compute::Compute;
use crate::device::connections::{ConnectedImage, Connections, NumberedImages};
use crate::device::image::DeviceImage;
use crate::device::layers::DeviceLayers;
use crate::device::on_gpu::OnGpu;
use crate::device::sorting::Sorting;
use crate::error::SessionError;
use crate::progress::Monitor;

/// A gather that the GPU does where there is one, else the CPU. Diffuse light is connected where the scene is at hand.
pub(crate) struct DeviceGather {
    gather: Gather,
    /// Connections, and the number of their levels that count.
    connections: Option<(Arc<Connections>, usize)>,
    pub(crate) on_gpu: OnGpu<GpuGather>,
    may_sort: AtomicBool,
    pub(crate) sorting: Sorting,
    told_of_little_memory: Once,
}

/// Haste with which lights are connected.
#[derive(Clone, Copy)]
pub(crate) enum Haste<'a> {
    /// Only one path, and one pixel of each block of so many each way, of lights that are new, until this is true.
    Drag(usize, &'a (dyn Fn() -> bool + Sync)),
    /// All, until this is true.
    Until(&'a (dyn Fn() -> bool + Sync)),
}

impl Haste<'_> {
    /// None at all.
    pub const NONE: Self = Self::Until(&|| false);
}

/// Unit image of a light in two parts.
pub(crate) struct UnitParts {
    /// Sum over the crossings of a pass.
    pub crossed: DeviceImage,
    /// Diffuse light that is connected, of as many paths as so far; none where it is summed over crossings.
    pub connected: Option<Arc<ConnectedImage>>,
}

impl From<DeviceImage> for UnitParts {
    fn from(crossed: DeviceImage) -> Self {
        Self { crossed, connected: None }
    }
}

impl DeviceGather {
    pub fn new(gather: Gather) -> Self {
        Self {
            gather,
            connections: None,
            on_gpu: OnGpu::default(),
            may_sort: false.into(),
            sorting: Sorting::default(),
            told_of_little_memory: Once::new(),
        }
    }

    /// Connects lights from now on, by so many levels.
    pub fn connect(&mut self, connections: &Arc<Connections>, levels: usize) {
        self.connections = Some((Arc::clone(connections), levels));
    }

    /// Connections of the scene, where it is at hand.
    pub fn connections(&self) -> Option<&Arc<Connections>> {
        self.connections.as_ref().map(|(connections, _)| connections)
    }

    /// True if a light is connected.
    pub fn connects(&self, light: &Light) -> bool {
        self.connections.is_some() && Emitter::covers(light, self.gather.dump().manifest())
    }

    /// Allows sorting the copy on the GPU in the background after several relights, once nothing else needs the CPU.
    pub fn allow_sorting(&self) {
        self.may_sort.store(true, Ordering::Relaxed);
    }

    pub fn gather(&self) -> &Gather {
        &self.gather
    }

    /// Paths per pixel.
    pub fn samples(&self) -> u32 {
        self.gather.dump().manifest().samples()
    }

    /// Unit images of some lights, connected by all levels.
    pub fn unit_images(
        &self,
        lights: &[Light],
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<Vec<Image>, SessionError> {
        if let Some((connections, levels)) = &self.connections {
            connections.prepare(*levels);
        }
        let work =
            |on_gpu: &GpuGather, lights: &[PreparedLight]| on_gpu.unit_images(lights, SampleSplit::All);
        let (mut images, connected) =
            self.images(lights, Haste::NONE, (compute, monitor), work, |image| image)?;
        for (light, connected) in connected {
            images[light].add_scaled(&connected.image, &[1.0; 3]);
        }
        Ok(images)
    }

    /// Sums of some lights over the crossings of some of the paths.
    pub fn crossed_images(
        &self,
        crossed: &[PreparedLight],
        split: SampleSplit,
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<Vec<Image>, SessionError> {
        let work = |on_gpu: &GpuGather, lights: &[PreparedLight]| on_gpu.unit_images(lights, split);
        self.sums(crossed, split, (compute, monitor), work, |image| image)
    }

    /// Parts of unit images: of crossings, which stay on the GPU where that makes them and has room, and of connections. They are
    /// there when this returns.
    ///
    /// # Errors
    /// [`SessionError::Cancelled`] if `haste` says so.
    pub fn unit_parts(
        &self,
        lights: &[Light],
        haste: Haste<'_>,
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<Vec<UnitParts>, SessionError> {
        let split = SampleSplit::All;
        let work = |on_gpu: &GpuGather, lights: &[PreparedLight]| match on_gpu.gpu_images(lights, split) {
            Err(GatherError::Gpu(GpuError::OutOfMemory { .. })) => {
                Ok(on_gpu.unit_images(lights, split)?.into_iter().map(DeviceImage::Cpu).collect())
            }
            images => {
                let images = images?;
                on_gpu.wait()?;
                images.into_iter().map(|image| Ok(DeviceImage::from_gpu(image)?)).collect()
            }
        };
        let (images, connected) = self.images(lights, haste, (compute, monitor), work, DeviceImage::Cpu)?;
        let mut parts: Vec<UnitParts> = images.into_iter().map(UnitParts::from).collect();
        for (light, image) in connected {
            parts[light].connected = Some(image);
        }
        Ok(parts)
    }

    /// Unit images by crossings, as the GPU or the CPU gives them, and by connections for some of the lights.
    fn images<R>(
        &self,
        lights: &[Light],
        haste: Haste<'_>,
        devices: (&Compute, &Monitor),
        on_gpu: impl Fn(&GpuGather, &[PreparedLight]) -> Result<Vec<R>, GatherError>,
        of_cpu: impl Fn(Image) -> R,
    ) -> Result<(Vec<R>, NumberedImages), SessionError> {
        let crossed = match &self.connections {
            Some((connections, _)) => connections.crossed(&self.gather, lights)?,
            None => self.gather.prepare_all(lights)?,
        };
        let images = self.sums(&crossed, SampleSplit::All, devices, on_gpu, of_cpu)?;
        let Some((connections, levels)) = &self.connections else { return Ok((images, Vec::new())) };
        let emitters = connections.emitters(lights)?;
        let diffuse = match haste {
            Haste::Drag(block, stop) => {
                connections.coarse_images(&self.gather, lights, &emitters, block, stop)
            }
            Haste::Until(stop) => connections.images(&self.gather, lights, &emitters, *levels, stop),
        };
        Ok((images, diffuse.ok_or(SessionError::Cancelled)?))
    }

    /// The unit image of a light in its parts ([`relume_gather::LobePart::ALL`]), which add up to it; by the CPU.
    ///
    /// # Errors
    /// [`SessionError::Cancelled`] if `stop` ended it; if the light is none.
    pub fn part_images(
        &self,
        light: &Light,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<Vec<Image>, SessionError> {
        let lights = std::slice::from_ref(light);
        let crossed = match &self.connections {
            Some((connections, _)) => connections.crossed(&self.gather, lights)?,
            None => self.gather.prepare_all(lights)?,
        };
        let mut parts = self.gather.part_images(&crossed[0]);
        if let Some((connections, levels)) = &self.connections {
            for (_, emitter) in connections.emitters(lights)? {
                let connected = connections.part_images(&self.gather, &emitter, *levels, stop);
                let connected = connected.ok_or(SessionError::Cancelled)?;
                parts.iter_mut().zip(&connected).for_each(|(part, image)| part.add_scaled(image, &[1.0; 3]));
            }
        }
        Ok(parts)
    }

    /// Sums over crossings, as the GPU or the CPU gives them.
    fn sums<R>(
        &self,
        crossed: &[PreparedLight],
        split: SampleSplit,
        (compute, monitor): (&Compute, &Monitor),
        on_gpu: impl Fn(&GpuGather, &[PreparedLight]) -> Result<Vec<R>, GatherError>,
        of_cpu: impl Fn(Image) -> R,
    ) -> Result<Vec<R>, SessionError> {
        let work = |gather: &GpuGather| on_gpu(gather, crossed);
        let images = self.on_gpu.attempt(compute, monitor, |gpu| self.put_on(gpu), work)?;
        if images.is_some() && self.may_sort.load(Ordering::Relaxed) {
            self.sorting.relit(|| self.on_gpu.get());
        }
        let on_cpu = || {
            let (gather, split) = self.gather.split(split);
            gather.unit_images(crossed, split).into_iter().map(of_cpu).collect()
        };
        Ok(images.unwrap_or_else(on_cpu))
    }

    /// Connected light of lights that are, by their number, from so many levels as far as they are there.
    ///
    /// # Errors
    /// [`SessionError::Cancelled`] if `stop` ended it; if a light is none.
    pub fn connected(
        &self,
        lights: &[Light],
        levels: usize,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<NumberedImages, SessionError> {
        let Some((connections, _)) = &self.connections else { return Ok(Vec::new()) };
        let emitters = connections.emitters(lights)?;
        connections.images(&self.gather, lights, &emitters, levels, stop).ok_or(SessionError::Cancelled)
    }

    /// Light of a world in the picture.
    pub fn world_image(
        &self,
        environment: &Environment,
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<Image, SessionError> {
        let work = |on_gpu: &GpuGather| on_gpu.world_image(environment, SampleSplit::All);
        let image = self.on_gpu.attempt(compute, monitor, |gpu| self.put_on(gpu), work)?;
        Ok(image.unwrap_or_else(|| self.gather.world_image(environment, SampleSplit::All)))
    }

    /// A smoothed light's values at some cells with their derivatives; `soft` is of the same dump. On the CPU where the GPU's memory
    /// has no room for parts of the dump.
    pub fn linearise(
        &self,
        soft: &SoftGather,
        (light, softness): (&Light, f32),
        cells: &[u32],
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<UnitValues, SessionError> {
        let work = |on_gpu: &GpuGather| on_gpu.linearise(soft, light, softness, cells);
        let linear = self.if_it_gathers_pixels(compute, monitor, work)?;
        linear.map_or_else(|| Ok(soft.linearise(light, softness, cells)?), Ok)
    }

    /// [`GpuGather::compare`] over layers times radiances; none if the CPU has to do it.
    pub fn compare(
        &self,
        soft: &SoftGather,
        (lights, softness): (&[&Light], f32),
        (layers, radiances, look): (&DeviceLayers, &[[f32; 3]], &StepTargets),
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<Option<SoftCompared>, SessionError> {
        let work = |on_gpu: &GpuGather| {
            let goals = Goals { layers: &*layers.on(on_gpu.gpu())?, radiances, targets: look };
            on_gpu.compare(soft, lights, softness, &goals)
        };
        self.if_it_gathers_pixels(compute, monitor, work)
    }

    /// Runs work on the GPU if that has room for the parts of the dump that it needs.
    fn if_it_gathers_pixels<R>(
        &self,
        compute: &Compute,
        monitor: &Monitor,
        work: impl Fn(&GpuGather) -> Result<R, GatherError>,
    ) -> Result<Option<R>, SessionError> {
        let tell = || {
            monitor.warn(
                "there is no room in the GPU's memory for parts of the bake: the CPU smooths lights for solving; raise \
                 --gpu-memory",
            );
        };
        let by_cpu = || {
            self.told_of_little_memory.call_once(tell);
            Ok(None)
        };
        let work = |on_gpu: &GpuGather| match on_gpu.gathers_pixels() {
            true => match work(on_gpu) {
                Err(GatherError::Gpu(GpuError::OutOfMemory { .. })) if !on_gpu.is_resident() => by_cpu(),
                result => result.map(Some),
            },
            false => by_cpu(),
        };
        Ok(self.on_gpu.attempt(compute, monitor, |gpu| self.put_on(gpu), work)?.flatten())
    }

    fn put_on(&self, gpu: Arc<Gpu>) -> Result<GpuGather, GatherError> {
        self.sorting.begin_again();
        GpuGather::new(gpu, &self.gather)
    }
}

#[cfg(test)]
mod tests {

    use relume_gpu::GpuChoice;

    use super::*;
    use crate::progress::Cancel;
    use crate::test_box::{boxed, bulbs};
    use crate::test_warnings::Warnings;

    #[test]
    fn smoothed_lights_that_find_no_room_on_the_gpu_are_made_by_the_cpu_which_is_told_once() {
        let gather = DeviceGather::new(Gather::new(boxed((128, 80), 16).unwrap()));
        let soft = SoftGather::new(gather.gather(), 1);
        let light = &bulbs(1)[0];
        let gpu = Gpu::open(&GpuChoice::Best).expect("tests need a GPU or a software driver");
        let warnings = Arc::new(Warnings::default());
        let monitor = Monitor::new(warnings.clone(), Cancel::default());
        let compute = Compute::with(Arc::clone(&gpu), false);
        let of_cpu = |cells: &[u32]| soft.linearise(light, 0.1, cells).unwrap();
        let found = |cells: &[u32]| gather.linearise(&soft, (light, 0.1), cells, &compute, &monitor).unwrap();
        let warned = || warnings.0.lock().unwrap().len();

        gpu.set_memory_budget(Some(8 << 20));
        found(&[5, 70]);
        let on_gpu = gather.on_gpu.get().unwrap();
        let copied = on_gpu.copied_bytes();
        assert!(!on_gpu.is_resident() && copied > 0 && warned() == 0);
        // Their values alone take more.
        let many: Vec<u32> = (0..10_240).cycle().take(80_000).collect();
        assert!(found(&many) == of_cpu(&many) && warned() == 1);
        gpu.set_memory_budget(Some(1 << 20));
        assert!(found(&[5, 70]) == of_cpu(&[5, 70]) && warned() == 1);
        assert_eq!(on_gpu.copied_bytes(), copied);
    }
}
