//! The gather on a GPU: the same images as those of the CPU, up to the order of sums.
//!
//! The dump stays on the device if it fits into the memory budget; else each call streams it from its shards: the CPU hands over
//! the next two chunks while the device works on the present one. Calls that want some pixels alone, for a training or to solve
//! lights, stream the records of those (`pixels`). Each pixel is summed up by a fixed number of threads in a
//! fixed order, so that results are the same in every run.
//!
//! A small light costs less than reading everything once the segments are sorted ([`GpuGather::sort`]): in groups of pixels
//! (`sort`), as blocks with bounds (`bounds`), of which those are left out that no light may touch (`sorted`).
//!
//! Divisions and square roots of WGSL are off by a few units in the last place, and products may be fused with sums: a
//! segment that grazes the edge of a light within that may be decided otherwise than on the CPU. Everything else is equal.

mod arguments;
mod bounds;
mod chunk;
mod compare;
mod kernels;
mod light;
mod pixels;
mod soft;
mod sort;
mod sorted;
mod world;

use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex, OnceLock};

use relume_dump::Dump;
use relume_gpu::{Buffer, Commands, Gpu, GpuError, GpuImage, Submission};
use relume_image::Image;

use crate::kernel::magnitude;
use crate::{Gather, GatherError, PreparedLight, SampleSplit};
use arguments::{ImagesArguments, TargetsArguments};
use chunk::{ChunkPlan, ChunkRecords, ChunkTable, GpuChunk, MOST_PENDING, RECORD_BYTES};
pub use compare::{Goals, SoftCompared};
use kernels::{GROUP_SIZE, LIGHTS, SORTED_LIGHTS, lanes};
pub use light::{GpuLight, GpuLights, Receivers};
use sorted::Sorted;
pub use world::GpuWorld;

/// Largest buffer of a chunk: larger ones are harder to find room for.
const BUFFER_BYTES: u64 = 1 << 30;
/// Share of the free memory that a streamed dump takes.
const STREAM_SHARE: f64 = 0.9;
/// Chunks of a streamed dump on the device: one that is worked on, one that waits for it, one that is copied.
const STREAM_PLACES: usize = 3;

/// [`Gather`] on a GPU.
#[derive(Debug)]
pub struct GpuGather {
    gpu: Arc<Gpu>,
    dump: Dump,
    /// Largest coordinate in the dump.
    magnitude: f32,
    /// Most records of a chunk.
    chunk_limit: usize,
    /// The dump on the device; nothing if it does not fit.
    resident: Option<Vec<GpuChunk>>,
    /// Sorted segments on the device, if asked for.
    sorted: OnceLock<Sorted>,
    /// Mean records of a pixel in a shard.
    part_length: usize,
    /// Submission that last used the copied records of single pixels.
    last_copied: Mutex<Option<Submission>>,
    /// Bytes of such records so far.
    copied: AtomicU64,
}

/// Images of some of the lights of a call, one behind the other.
struct Images {
    /// Place of the first light on the device.
    first_light: usize,
    /// Numbers by which the caller knows the lights.
    lights: Vec<usize>,
    sums: Buffer<f32>,
    /// True if they are gathered from the sorted segments.
    sorted: bool,
}

impl GpuGather {
    /// Copies the dump of a gather to the device if it fits into the free memory, with room for images.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn new(gpu: Arc<Gpu>, gather: &Gather) -> Result<Self, GatherError> {
        let chunk_limit = (gpu.limits().buffer.min(BUFFER_BYTES) / 4) as usize & !3;
        Self::in_chunks(gpu, gather, chunk_limit)
    }

    /// [`GpuGather::new`] with chunks of at most so many records.
    fn in_chunks(gpu: Arc<Gpu>, gather: &Gather, chunk_limit: usize) -> Result<Self, GatherError> {
        let mut gather = Self::streaming(gpu, gather, chunk_limit);
        let plans = ChunkPlan::cut(&gather.dump, chunk_limit);
        let tables: u64 = plans.iter().map(|plan| GpuChunk::most_bytes_beside(plan, &gather.dump)).sum();
        let needed = gather.dump.record_count() as u64 * RECORD_BYTES + tables;
        if gather.has_room(needed) {
            let chunks = plans.into_iter().map(|plan| GpuChunk::new(&gather.gpu, plan));
            gather.resident = if_it_fits(chunks.collect())?;
        }
        Ok(gather)
    }

    /// Gather of which nothing stays on the device.
    fn streaming(gpu: Arc<Gpu>, gather: &Gather, chunk_limit: usize) -> Self {
        let dump = gather.dump().clone();
        let largest = |shard: &Arc<relume_dump::Shard>| magnitude(shard, glam::Vec3::ZERO);
        let magnitude = dump.shards().map(largest).fold(0.0, f32::max);
        let parts: usize = dump.shards().map(|shard| shard.rect().pixel_count()).sum();
        let part_length = dump.record_count() / parts.max(1);
        Self {
            gpu,
            dump,
            magnitude,
            chunk_limit,
            resident: None,
            sorted: OnceLock::new(),
            part_length,
            last_copied: Mutex::default(),
            copied: AtomicU64::default(),
        }
    }

    /// Device of the gather.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// True if the dump stays on the device.
    pub fn is_resident(&self) -> bool {
        self.resident.is_some()
    }

    /// True if so many bytes leave room for images.
    fn has_room(&self, bytes: u64) -> bool {
        let images = 2 * LIGHTS[LIGHTS.len() - 1] * self.image_values() * size_of::<f32>();
        bytes + images as u64 <= self.gpu.free_memory()
    }

    /// Copies lights to the device, for [`GpuGather::pixel_targets`].
    ///
    /// # Errors
    /// If there is no room for them, or the device was lost.
    pub fn lights(&self, lights: &[PreparedLight]) -> Result<GpuLights, GatherError> {
        Ok(GpuLights::new(&self.gpu, lights, self.magnitude)?)
    }

    /// [`Gather::unit_images`], read back.
    ///
    /// # Errors
    /// If there is no room for the images, or the device was lost.
    pub fn unit_images(
        &self,
        lights: &[PreparedLight],
        half: SampleSplit,
    ) -> Result<Vec<Image>, GatherError> {
        let values = self.image_values();
        let manifest = self.dump.manifest();
        let mut images = vec![Image::new(manifest.width, manifest.height, 3); lights.len()];
        for group in self.gather(lights, half)? {
            for (number, &light) in group.lights.iter().enumerate() {
                self.gpu.read_into(&group.sums, number * values, &mut images[light].data)?;
            }
        }
        Ok(images)
    }

    /// [`GpuGather::unit_images`] that stay on the device. Does not wait for them.
    ///
    /// # Errors
    /// If there is no room for the images, or the device was lost.
    pub fn gpu_images(
        &self,
        lights: &[PreparedLight],
        half: SampleSplit,
    ) -> Result<Vec<GpuImage>, GatherError> {
        let manifest = self.dump.manifest();
        let black = || GpuImage::black(&self.gpu, manifest.width, manifest.height);
        let images = lights.iter().map(|_| black()).collect::<Result<Vec<_>, _>>()?;
        let values = self.image_values();
        let mut commands = self.gpu.commands("unit images");
        for group in self.gather(lights, half)? {
            for (number, &light) in group.lights.iter().enumerate() {
                let sums = number * values..(number + 1) * values;
                commands.copy_part(&group.sums, sums, images[light].values(), 0);
            }
        }
        commands.submit()?;
        Ok(images)
    }

    /// Waits until all that was submitted is done.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn wait(&self) -> Result<(), GatherError> {
        Ok(self.gpu.wait()?)
    }

    /// [`Gather::pixel_into`] on the device, for targets of a training: `pixels` are places in the image, row by row, and
    /// `lights` has `lights_per_pixel` for each of them, or for each run of neighbours in the list if it has fewer. `out` becomes RGB,
    /// pixel by pixel, then light by light. Only submits: `out` can be used by what is submitted next. Of a dump that does not stay on
    /// the device, the records of these pixels are copied there.
    ///
    /// # Errors
    /// If there is no room for that ([`GpuGather::gathers_pixels`]), or the device was lost.
    ///
    /// # Panics
    /// If the lengths do not fit together.
    pub fn pixel_targets(
        &self,
        pixels: &[u32],
        lights: &GpuLights,
        lights_per_pixel: u32,
        half: SampleSplit,
        out: &Buffer<f32>,
    ) -> Result<(), GatherError> {
        let values = pixels.len() * lights_per_pixel as usize;
        let sharing = values / lights.lights.len();
        assert!(
            lights.lights.len() * sharing == values && pixels.len().is_multiple_of(sharing),
            "lights of pixels"
        );
        assert!(out.len() == 3 * values, "{values} pixels times lights");
        let most = (lights_per_pixel as usize).min(LIGHTS[LIGHTS.len() - 1]);
        let places = self.gpu.buffer_of("pixels of targets", pixels)?;
        let mut commands = self.gpu.commands("pixel targets");
        commands.clear(out);
        commands.submit()?;
        self.each_chunk_of(
            || pixels.to_vec(),
            half,
            |records, table, numbers| {
                let mut commands = self.gpu.commands("pixel targets");
                let lanes = lanes(table.part_length);
                let kernel = kernels::targets(&self.gpu, most, lanes)?;
                let mut bindings = vec![lights.lights.whole(), lights.receivers.whole()];
                bindings.extend(table.bindings_and_shards(records));
                bindings.extend([numbers.whole(), places.whole(), out.whole()]);
                let bound = kernel.bind(&bindings)?;
                for first_light in (0..lights_per_pixel).step_by(most.max(1)) {
                    let count = (lights_per_pixel - first_light).min(most as u32);
                    let arguments = TargetsArguments {
                        targets: pixels.len() as u32,
                        lights: lights_per_pixel,
                        first_light,
                        count,
                        sharing: sharing as u32,
                    };
                    let groups = (pixels.len() as u32).div_ceil(GROUP_SIZE / lanes);
                    commands.run(&bound, groups, bytemuck::bytes_of(&arguments));
                }
                Ok(commands)
            },
        )
    }

    /// Values of an RGB image.
    fn image_values(&self) -> usize {
        3 * self.pixel_count()
    }

    fn gather(&self, lights: &[PreparedLight], half: SampleSplit) -> Result<Vec<Images>, GatherError> {
        let sorted = self.sorted.get();
        let pays = |light: &PreparedLight| {
            sorted.is_some_and(|sorted| sorted.pays(&GpuLight::new(light, self.magnitude, 0)))
        };
        let (small, large): (Vec<_>, Vec<_>) = (0..lights.len()).partition(|&light| pays(&lights[light]));
        self.gather_as(lights, half, &small, &large)
    }

    /// Images of some lights from the sorted segments, which must be there if there are such lights, and of others in the
    /// order of paths.
    fn gather_as(
        &self,
        lights: &[PreparedLight],
        half: SampleSplit,
        small: &[usize],
        large: &[usize],
    ) -> Result<Vec<Images>, GatherError> {
        let on_device = self.lights_in_order(lights, small.iter().chain(large))?;
        let mut images = self.images(small, 0, &SORTED_LIGHTS)?;
        images.iter_mut().for_each(|group| group.sorted = true);
        images.extend(self.images(large, small.len(), &LIGHTS)?);
        if let Some(sorted) = self.sorted.get() {
            self.add_sorted(sorted, half, &on_device, &images)?;
        }
        if large.is_empty() {
            return Ok(images);
        }
        self.each_chunk(half, |records, table| self.add_chunk(records, table, &on_device, &images))?;
        Ok(images)
    }

    /// Submits the commands that `add` makes of each chunk.
    fn each_chunk<'a>(
        &'a self,
        half: SampleSplit,
        add: impl Fn(&ChunkRecords, &ChunkTable) -> Result<Commands<'a>, GatherError>,
    ) -> Result<(), GatherError> {
        let Some(chunks) = &self.resident else { return self.stream(half, add) };
        for chunk in chunks {
            let table = chunk.table(&self.gpu, &self.dump, half)?;
            add(&chunk.records, &table)?.submit()?;
        }
        Ok(())
    }

    fn lights_in_order<'a>(
        &self,
        lights: &[PreparedLight],
        order: impl Iterator<Item = &'a usize>,
    ) -> Result<GpuLights, GatherError> {
        let lights: Vec<_> = order.map(|&light| lights[light].clone()).collect();
        self.lights(&lights)
    }

    /// Black images for lights that lie one behind the other from `first` on, as many together as the largest of the kernels
    /// takes.
    fn images(&self, lights: &[usize], first: usize, kernels: &[usize]) -> Result<Vec<Images>, GatherError> {
        let image_bytes = (self.image_values() * size_of::<f32>()).max(1);
        let most = (self.gpu.limits().buffer as usize / image_bytes).clamp(1, kernels[kernels.len() - 1]);
        let group = |(number, lights): (usize, &[usize])| {
            let sums = self.gpu.zeros("unit images", lights.len() * self.image_values())?;
            Ok(Images { first_light: first + number * most, lights: lights.to_vec(), sums, sorted: false })
        };
        lights.chunks(most).enumerate().map(group).collect()
    }

    /// Adds what the sorted segments give for the lights that are gathered from them.
    fn add_sorted(
        &self,
        sorted: &Sorted,
        half: SampleSplit,
        lights: &GpuLights,
        images: &[Images],
    ) -> Result<(), GatherError> {
        let mut commands = self.gpu.commands("gather sorted segments");
        for group in images.iter().filter(|group| group.sorted) {
            let count = group.lights.len();
            let kernel = kernels::blocks(&self.gpu, count)?;
            sorted.add(&mut commands, &kernel, lights, (group.first_light, count), half, &group.sums)?;
        }
        Ok(commands.submit()?)
    }

    /// [`GpuGather::each_chunk`] from the shards.
    fn stream<'a>(
        &'a self,
        half: SampleSplit,
        add: impl Fn(&ChunkRecords, &ChunkTable) -> Result<Commands<'a>, GatherError>,
    ) -> Result<(), GatherError> {
        let plans = self.streamed_plans();
        let room = plans.iter().map(|plan| plan.records).max().unwrap_or(0);
        self.in_turns(&plans, room, |place, plan| {
            place.write(&self.gpu, plan)?;
            let table = ChunkTable::new(&self.gpu, &self.dump, plan, half)?;
            let submission = add(place, &table)?.submit_tracked()?;
            Ok((table, submission))
        })?;
        Ok(())
    }

    /// Hands chunks over to places of so many records, and says what was submitted last. While the device works on one chunk, the
    /// next ones are handed over for the other places. None is larger than what is handed over without waiting: the device does one
    /// thing after the other, so that a copy of which a part is waited for would wait for the chunk before it.
    fn in_turns<P>(
        &self,
        chunks: &[P],
        room: usize,
        hand_over: impl Fn(&ChunkRecords, &P) -> Result<(ChunkTable, Submission), GatherError>,
    ) -> Result<Option<Submission>, GatherError> {
        let places = (0..STREAM_PLACES.min(chunks.len())).map(|_| ChunkRecords::new(&self.gpu, room));
        let places = places.collect::<Result<Vec<_>, _>>()?;
        let mut under_way: [Option<(ChunkTable, Submission)>; STREAM_PLACES] =
            [const { None }; STREAM_PLACES];
        for (number, chunk) in chunks.iter().enumerate() {
            let (place, before) = (&places[number % STREAM_PLACES], &mut under_way[number % STREAM_PLACES]);
            if let Some((_, submission)) = before.take() {
                self.gpu.wait_for(submission)?;
            }
            *before = Some(hand_over(place, chunk)?);
        }
        let last = chunks.len().checked_sub(1).and_then(|last| under_way[last % STREAM_PLACES].take());
        Ok(last.map(|(_, submission)| submission))
    }

    /// Chunks of which [`STREAM_PLACES`] fit into the free memory with their tables, and that are handed over at once.
    fn streamed_plans(&self) -> Vec<ChunkPlan> {
        let free = self.gpu.free_memory() as f64 * STREAM_SHARE;
        let fitting = (free / STREAM_PLACES as f64 / RECORD_BYTES as f64) as usize;
        let mut records = self.chunk_limit.min(MOST_PENDING).min(fitting);
        loop {
            let plans = ChunkPlan::cut(&self.dump, records);
            let largest = |bytes: &dyn Fn(&ChunkPlan) -> u64| plans.iter().map(bytes).max().unwrap_or(0);
            let of_records = largest(&|plan| plan.records as u64 * RECORD_BYTES);
            let needed = STREAM_PLACES as f64 * (of_records + largest(&ChunkTable::bytes)) as f64;
            if needed <= free || records == 0 {
                return plans;
            }
            // Tables shrink about as records do.
            records = (records as f64 * (free / needed).min(0.9)) as usize;
        }
    }

    /// Adds what a chunk gives for all lights.
    fn add_chunk(
        &self,
        records: &ChunkRecords,
        table: &ChunkTable,
        lights: &GpuLights,
        images: &[Images],
    ) -> Result<Commands<'_>, GatherError> {
        let mut commands = self.gpu.commands("gather");
        let lanes = lanes(table.part_length);
        for group in images.iter().filter(|group| !group.sorted) {
            let kernel = kernels::images(&self.gpu, group.lights.len(), lanes)?;
            let mut bindings = vec![lights.lights.whole(), lights.receivers.whole()];
            bindings.extend(table.bindings_and_shards(records));
            bindings.push(group.sums.whole());
            let arguments = ImagesArguments {
                pixels: table.pixel_count,
                first_light: group.first_light as u32,
                lights: group.lights.len() as u32,
                stride: self.image_values() as u32,
            };
            let groups = table.pixel_count.div_ceil(GROUP_SIZE / lanes);
            commands.run(&kernel.bind(&bindings)?, groups, bytemuck::bytes_of(&arguments));
        }
        Ok(commands)
    }
}

/// Turns a lack of memory into nothing: the device has less than its driver says, or others were faster to take it.
fn if_it_fits<T>(made: Result<T, GpuError>) -> Result<Option<T>, GatherError> {
    match made {
        Err(GpuError::OutOfMemory { .. }) => Ok(None),
        made => Ok(Some(made?)),
    }
}

#[cfg(test)]
mod map_tests;
#[cfg(test)]
mod tests;
