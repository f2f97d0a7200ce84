use std::sync::OnceLock;
use std::time::Instant;

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use relume_dump::{Dump, Flags};
use relume_gpu::{Buffer, Commands, Gpu, GpuError, Kernel};
use relume_scene::{Light, LightShape};

use super::bounds::{BoundsFrame, SegmentBounds};
use super::chunk::GpuShard;
use super::light::{GpuLight, GpuLights};
use super::sort::{BLOCK, BlockCount, Blocks, MOST_SHARDS, PixelGroup};
use super::{GpuGather, if_it_fits};
use crate::{GatherError, PreparedLight, SampleSplit};

/// Blocks that are sorted at a time, 256 MiB: until they are on the device they are in the CPU's memory.
const BLOCKS_AT_ONCE: usize = 1 << 18;
/// Bytes of a segment on the device, those more where it continues a ray, and those of the bounds of a block.
const SEGMENT_BYTES: usize = 20;
const BEHIND_BYTES: usize = 4;
const BOUNDS_BYTES: usize = size_of::<SegmentBounds>();
/// Bytes that the gather in the order of paths reads of a segment that the light is far from.
const PATH_ORDER_BYTES: f64 = 8.0;
/// Radii of lights of which one stands for small ones, in diagonals of the scene: the first that touches so large a share of
/// the blocks that to read them takes time.
const SMALL: [f32; 4] = [0.05, 0.1, 0.2, 0.4];
const ENOUGH: f64 = 0.02;
/// Repetitions of which the quickest says how long a gather takes: the first compiles kernels, and others use the
/// device meanwhile.
const TRIES: usize = 4;
/// Blocks that stand for all where the share of those that a light touches is estimated.
const SAMPLE: usize = 4096;

/// `Group` of `shaders/gather/blocks.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct GpuGroup {
    first_pixel: u32,
    width: u32,
    pixels: u32,
    first_block: u32,
    end_block: u32,
    first_shard: u32,
    behind_shift: u32,
    scales: [f32; 3],
}

/// `Arguments` of `shaders/gather/blocks.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Arguments {
    frame: BoundsFrame,
    first_light: u32,
    lights: u32,
    paths: u32,
    image_width: u32,
    stride: u32,
    unused: [u32; 3],
}

/// A group and how many blocks it has.
type Counted = (PixelGroup, BlockCount);

/// A dump on the device whose segments are sorted, so that most of them need not be read for a small light.
#[derive(Debug)]
pub struct Sorted {
    frame: BoundsFrame,
    chunks: Vec<SortedChunk>,
    sample: Vec<SegmentBounds>,
    image: [usize; 2],
    byte_cost: OnceLock<f64>,
}

#[derive(Debug)]
struct SortedChunk {
    segments: Buffer<[u32; 4]>,
    throughput: Buffer<u32>,
    bounds: Buffer<SegmentBounds>,
    shards: Buffer<GpuShard>,
    groups: Buffer<GpuGroup>,
    /// [`Blocks::behind`] of the segments that continue a ray.
    behind: Buffer<f32>,
}

impl SortedChunk {
    /// Room for the segments of some groups, whose blocks are counted.
    fn new(gpu: &Gpu, dump: &Dump, groups: &[Counted]) -> Result<Self, GpuError> {
        let (mut shards, mut table) = (Vec::new(), Vec::new());
        let (mut blocks, mut continuing) = (0, 0);
        let mut first_shard = (usize::MAX, 0);
        for (group, count) in groups {
            if first_shard.0 != group.tile {
                first_shard = (group.tile, shards.len() as u32);
                shards.extend(dump.tile(group.tile).map(|shard| GpuShard::new(shard)));
            }
            let scale = |half: SampleSplit| 1.0 / half.tile_samples(dump, group.tile).max(1) as f32;
            table.push(GpuGroup {
                first_pixel: group.place(dump) as u32,
                width: group.width as u32,
                pixels: group.pixel_count() as u32,
                first_block: blocks as u32,
                end_block: (blocks + count.all) as u32,
                first_shard: first_shard.1,
                behind_shift: ((blocks + count.all - count.continuing - continuing) * BLOCK) as u32,
                scales: [SampleSplit::All, SampleSplit::First, SampleSplit::Second].map(scale),
            });
            blocks += count.all;
            continuing += count.continuing;
        }
        Ok(Self {
            segments: gpu.zeros("sorted segments", blocks * BLOCK)?,
            throughput: gpu.zeros("throughputs of sorted segments", blocks * BLOCK)?,
            bounds: gpu.zeros("bounds of sorted segments", blocks)?,
            shards: gpu.buffer_of("shards", &shards)?,
            groups: gpu.buffer_of("groups of pixels", &table)?,
            behind: gpu.zeros("ways behind sorted segments", continuing * BLOCK)?,
        })
    }

    /// Replaces the blocks from `first` on, whose ways behind are those from `first_behind` on.
    fn write(&self, gpu: &Gpu, first: usize, first_behind: usize, blocks: &Blocks) {
        gpu.write(&self.segments, first * BLOCK, &blocks.segments);
        gpu.write(&self.throughput, first * BLOCK, &blocks.throughput);
        gpu.write(&self.bounds, first, &blocks.bounds);
        gpu.write(&self.behind, first_behind, &blocks.behind);
    }
}

impl Sorted {
    /// Bytes on the device at most; nothing if a tile has more shards than can be numbered, or a group of pixels more segments
    /// than fit a buffer.
    pub fn bytes(gpu: &Gpu, dump: &Dump) -> Option<u64> {
        let many_shards = (0..dump.manifest().tile_count()).any(|tile| dump.tile(tile).count() > MOST_SHARDS);
        if many_shards || PixelGroup::all(dump).any(|group| group.room(dump) > most_segments(gpu)) {
            return None;
        }
        let padding = PixelGroup::all(dump).count() * PixelGroup::PADDING;
        let (segments, continuing) = (dump.record_count() + padding, continuing(dump));
        let behind = if continuing > 0 { continuing + padding } else { 0 };
        let bounds = segments.div_ceil(BLOCK) * BOUNDS_BYTES;
        Some((segments * SEGMENT_BYTES + behind * BEHIND_BYTES + bounds) as u64)
    }

    /// Sorts a dump on all threads of the current pool: some hundred nanoseconds a segment and thread. Nothing if that was
    /// cancelled.
    pub fn new(
        gpu: &Gpu,
        dump: &Dump,
        cancelled: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Self>, GpuError> {
        Self::in_chunks(gpu, dump, [most_segments(gpu) / BLOCK, BLOCKS_AT_ONCE], cancelled)
    }

    /// [`Sorted::new`] with chunks of at most so many blocks, but at least one group, and so many sorted at a time.
    pub fn in_chunks(
        gpu: &Gpu,
        dump: &Dump,
        [of_chunk, at_once]: [usize; 2],
        cancelled: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Self>, GpuError> {
        let manifest = dump.manifest();
        let mut sorted = Self {
            frame: BoundsFrame::new(dump),
            chunks: Vec::new(),
            sample: Vec::new(),
            image: [manifest.width, manifest.height],
            byte_cost: OnceLock::new(),
        };
        let groups: Vec<_> = PixelGroup::all(dump).collect();
        let blocks: Vec<_> = groups.par_iter().map(|group| group.block_count(dump)).collect();
        let groups: Vec<_> = groups.into_iter().zip(blocks).collect();
        let every = (dump.record_count() / BLOCK / SAMPLE).max(1);
        let sort = |(group, _): &Counted| (!cancelled()).then(|| group.sort(dump, &sorted.frame));
        for groups in runs(&groups, of_chunk) {
            let chunk = SortedChunk::new(gpu, dump, groups)?;
            let (mut first_block, mut first_behind) = (0, 0);
            for groups in runs(groups, at_once) {
                let all: Option<Vec<Blocks>> = groups.par_iter().map(sort).collect();
                let Some(all) = all else { return Ok(None) };
                for blocks in all {
                    chunk.write(gpu, first_block, first_behind, &blocks);
                    let to_next = first_block.next_multiple_of(every) - first_block;
                    sorted.sample.extend(blocks.bounds.iter().skip(to_next).step_by(every));
                    first_block += blocks.bounds.len();
                    first_behind += blocks.behind.len();
                }
                gpu.wait_for(gpu.submit_writes()?)?;
            }
            sorted.chunks.push(chunk);
        }
        Ok(Some(sorted))
    }

    /// Bytes that are read for a light per segment of the dump, estimated: the bounds of all blocks, and the segments of those
    /// that it may touch.
    pub fn bytes_per_segment(&self, light: &GpuLight) -> f64 {
        BOUNDS_BYTES as f64 / BLOCK as f64 + self.touched(light) * 16.0
    }

    /// The share of blocks that a light may touch, estimated.
    fn touched(&self, light: &GpuLight) -> f64 {
        let touched = self.sample.iter().filter(|bounds| bounds.may_be_touched(light, &self.frame)).count();
        touched as f64 / self.sample.len().max(1) as f64
    }

    /// True if a light is gathered sooner than in the order of paths: until that was measured, if less is read for it.
    pub fn pays(&self, light: &GpuLight) -> bool {
        self.bytes_per_segment(light) * self.byte_cost().unwrap_or(1.0) < PATH_ORDER_BYTES
    }

    /// Cost of a byte of these relative to one in the order of paths, once that was measured.
    pub fn byte_cost(&self) -> Option<f64> {
        self.byte_cost.get().copied()
    }

    /// A light in the middle of the scene by which times are compared; none where hardly any paths are. `magnitude` is the
    /// largest coordinate.
    pub fn small_light(&self, magnitude: f32) -> Option<PreparedLight> {
        let sphere = |part| {
            let (center, radius) = (self.frame.middle(), part * self.frame.diagonal());
            PreparedLight::new(&Light::unit(LightShape::Sphere { center, radius }), 0.0).ok()
        };
        let is_met = |light: &PreparedLight| self.touched(&GpuLight::new(light, magnitude, 0)) > ENOUGH;
        SMALL.into_iter().filter_map(sphere).find(is_met)
    }

    /// Notes the times that a light took from the sorted segments and in the order of paths.
    pub fn weigh(&self, light: &GpuLight, [sorted, in_path_order]: [f64; 2]) {
        let bytes = self.bytes_per_segment(light) / PATH_ORDER_BYTES;
        // Times are those of the first who asked; those of another are as good.
        let _ = self.byte_cost.set(sorted / in_path_order / bytes);
    }

    /// Adds what all segments give for `count` lights to their images.
    pub fn add(
        &self,
        commands: &mut Commands<'_>,
        kernel: &Kernel,
        lights: &GpuLights,
        (first_light, count): (usize, usize),
        half: SampleSplit,
        images: &Buffer<f32>,
    ) -> Result<(), GpuError> {
        let arguments = Arguments {
            frame: self.frame,
            first_light: first_light as u32,
            lights: count as u32,
            paths: half as u32,
            image_width: self.image[0] as u32,
            stride: (self.image[0] * self.image[1] * 3) as u32,
            unused: [0; 3],
        };
        for chunk in &self.chunks {
            let bound = kernel.bind(&[
                lights.lights.whole(),
                lights.receivers.whole(),
                chunk.segments.whole(),
                chunk.throughput.whole(),
                chunk.bounds.whole(),
                chunk.shards.whole(),
                chunk.groups.whole(),
                chunk.behind.whole(),
                images.whole(),
            ])?;
            commands.run(&bound, chunk.groups.len() as u32, bytemuck::bytes_of(&arguments));
        }
        Ok(())
    }
}

impl GpuGather {
    /// Sorts the segments so that a light that is small in the scene touches few of them: unit images of such lights then
    /// cost a fraction of what they did. Takes some hundred nanoseconds a segment and thread, and 21 bytes a segment of the
    /// device's memory, 25 of one that continues a ray; other calls go on meanwhile. Returns whether there was room for it.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn sort(&self) -> Result<bool, GatherError> {
        self.sort_within(1.0, &|| false)
    }

    /// [`GpuGather::sort`] if that takes at most this share of the free memory; ends without a result soon after `cancelled`
    /// has become true.
    ///
    /// # Errors
    /// See [`GpuGather::sort`].
    pub fn sort_within(
        &self,
        share: f64,
        cancelled: &(dyn Fn() -> bool + Sync),
    ) -> Result<bool, GatherError> {
        if self.sorted.get().is_some() {
            return Ok(true);
        }
        let most = (self.gpu.free_memory() as f64 * share) as u64;
        let fits = |bytes: u64| bytes <= most && self.has_room(bytes);
        if !Sorted::bytes(&self.gpu, &self.dump).is_some_and(fits) {
            return Ok(false);
        }
        let sorted = if_it_fits(Sorted::new(&self.gpu, &self.dump, cancelled))?.flatten();
        let Some(sorted) = sorted else { return Ok(false) };
        // If another thread was faster, its work is as good.
        let _ = self.sorted.set(sorted);
        Ok(true)
    }

    /// Learns by the clock for which lights the sorted segments, if there are any, are the quicker way on this device: until
    /// then those count for which less is read. Gathers a small light both ways, some times; ends soon after `cancelled` has
    /// become true. A dump that does not stay on the device is not measured: to copy it takes longer anyway.
    ///
    /// # Errors
    /// If there is no room for an image, or the device was lost.
    pub fn weigh_sorted(&self, cancelled: &dyn Fn() -> bool) -> Result<(), GatherError> {
        let (Some(sorted), true) = (self.sorted.get(), self.is_resident()) else { return Ok(()) };
        let Some(light) = sorted.small_light(self.magnitude) else { return Ok(()) };
        let light = [light];
        let mut least = [f64::INFINITY; 2];
        for _ in 0..TRIES {
            for (least, [small, large]) in least.iter_mut().zip([[&[0][..], &[]], [&[], &[0]]]) {
                if cancelled() {
                    return Ok(());
                }
                self.wait()?;
                let start = Instant::now();
                self.gather_as(&light, SampleSplit::All, small, large)?;
                self.wait()?;
                *least = least.min(start.elapsed().as_secs_f64());
            }
        }
        sorted.weigh(&GpuLight::new(&light[0], self.magnitude, 0), least);
        Ok(())
    }

    /// Bytes that are read for a light per segment of the dump once that is sorted ([`GpuGather::sort`]), estimated: bounds, and
    /// blocks that it may touch.
    pub fn sorted_bytes(&self, light: &PreparedLight) -> Option<f64> {
        let light = GpuLight::new(light, self.magnitude, 0);
        self.sorted.get().map(|sorted| sorted.bytes_per_segment(&light))
    }
}

/// Most segments of a chunk. What is in several is gathered one after the other, by few of the device's processors if they are small.
fn most_segments(gpu: &Gpu) -> usize {
    (gpu.limits().buffer / size_of::<[u32; 4]>() as u64) as usize
}

/// Number of segments that continue a ray.
fn continuing(dump: &Dump) -> usize {
    let shards: Vec<_> = dump.shards().collect();
    let continues = |word: &&u32| Flags((**word >> 16) as u16).continues();
    shards.into_par_iter().map(|shard| shard.position_z_flags().iter().filter(continues).count()).sum()
}

/// Groups, as many together as have this many blocks at most; one alone may have more.
fn runs(groups: &[Counted], most_blocks: usize) -> impl Iterator<Item = &[Counted]> {
    let mut blocks = 0;
    groups.chunk_by(move |(_, before), (_, after)| {
        blocks += before.all;
        let fits = blocks + after.all <= most_blocks;
        blocks *= usize::from(fits);
        fits
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::kernels::random_dump_of;

    relume_gpu::part_of_mirrors!(BoundsFrame as Struct);

    #[test]
    fn groups_are_taken_together_as_long_as_their_blocks_fit() {
        let group = PixelGroup::all(&random_dump_of(4, &[1])).next().unwrap();
        let groups = [3, 4, 2, 9, 1, 1].map(|all| (group, BlockCount { all, continuing: 1 }));
        let found: Vec<Vec<_>> =
            runs(&groups, 7).map(|groups| groups.iter().map(|(_, count)| count.all).collect()).collect();
        assert_eq!(found, [vec![3, 4], vec![2], vec![9], vec![1, 1]]);
    }

    #[test]
    fn groups_and_arguments_have_the_layout_of_their_wgsl_twins() {
        relume_gpu::assert_mirror!(GpuGroup as "gather/blocks", "Group", {
            first_pixel, width, pixels, first_block, end_block, first_shard, behind_shift, scales,
        });
        relume_gpu::assert_mirror!(Arguments as "gather/blocks", "Arguments", {
            frame, first_light, lights, paths, image_width, stride,
        });
        assert_eq!(relume_gpu::layout::constant("gather/blocks", "BLOCK").unwrap(), BLOCK as u32);
        relume_gpu::assert_mirror!(BoundsFrame as "gather/bounds", "Frame", { minimum, slack, step });
    }
}
