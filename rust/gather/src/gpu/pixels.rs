//! Single pixels of a dump that does not fit the device: the records that a call asks for are copied there, and no others.
//!
//! # What is copied
//!
//! Size of the paper's picture, 885 x 500 pixels at 512 samples of 3 segments (12 B each): 18 KB a pixel, 8.2 GB the
//! dump. A training draws 4,096 samples as 128 pixels under 32 lights each and uses them four times: 2.4 MB for 16,384
//! samples, its largest step, or 0.12 ms at the 20 GB/s of PCIe 4; the device meanwhile works on the step before. All
//! of its 32 M samples copy 4.8 GB (`targets_of_a_streamed_dump_copy_the_drawn_pixels_alone` counts). Whole passes on
//! the device, others every now and then, would take 8.2 GB to show each path once, and targets of the passes that are
//! there are noisier than those of all. A step of solving looks at 5 % of the picture: 0.4 GB, 20 ms. Before, the CPU
//! brings the records together; the benchmarks measure targets of a streamed dump, with all of that, beside those of
//! one that stays.

use std::ops::Range;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};

use relume_dump::{Dump, Shard};
use relume_gpu::{Buffer, Commands, Gpu};

use super::chunk::{ChunkRecords, ChunkTable, GpuPart, GpuPixel, GpuShard, MOST_PENDING, RECORD_BYTES};
use super::{GpuGather, STREAM_PLACES, STREAM_SHARE};
use crate::{GatherError, SampleSplit};

/// Free memory with which single pixels are gathered from a dump that does not fit: enough for hundreds of pixels at a time,
/// with their lights and values.
const LEAST_ROOM: u64 = 4 << 20;

/// Records that kernels load at once.
const LOAD: usize = 4;

/// A pixel that was asked for.
#[derive(Debug)]
struct Chosen<'a> {
    /// Place in the image, row by row.
    place: u32,
    tile: usize,
    runs: Vec<PixelRun<'a>>,
}

/// The records of a pixel in one of the shards of its tile.
#[derive(Debug)]
struct PixelRun<'a> {
    shard: &'a Shard,
    /// Number of the pixel within its tile.
    number: u32,
    records: Range<usize>,
}

impl<'a> Chosen<'a> {
    fn new(dump: &'a Dump, place: u32, half: SampleSplit) -> Self {
        let width = dump.manifest().width;
        let (tile, pixel) = dump.locate(place as usize % width, place as usize / width);
        let run = |(shard, number): (&'a Arc<Shard>, u32)| {
            let records = half.records(shard, pixel);
            (!records.is_empty()).then_some(PixelRun { shard, number, records })
        };
        Self { place, tile, runs: dump.tile(tile).zip(0..).filter_map(run).collect() }
    }

    /// Records, and what fills them up to whole loads of four: so that sums do not depend on what lies before the pixel.
    fn room(&self) -> usize {
        self.runs.iter().map(|run| run.records.len()).sum::<usize>().next_multiple_of(LOAD)
    }

    /// Some words of its records, as many as it has room for.
    fn words(&self, of: impl Fn(&'a Shard) -> &'a [u32]) -> impl Iterator<Item = &'a [u32]> {
        let filling = self.room() - self.runs.iter().map(|run| run.records.len()).sum::<usize>();
        let words = self.runs.iter().map(move |run| &of(run.shard)[run.records.clone()]);
        words.chain([&[0; LOAD][..filling]])
    }

    /// Bytes on the device, at most: every pixel of a chunk may be of another tile.
    fn bytes(&self, dump: &Dump) -> u64 {
        let per_shard = size_of::<GpuPart>() + size_of::<GpuShard>();
        let table = size_of::<GpuPixel>() + dump.tile(self.tile).count() * per_shard;
        self.room() as u64 * RECORD_BYTES + table as u64
    }
}

/// Cuts pixels into runs of at most so many bytes, or of a single one that has more.
fn cut<'p, 'a>(pixels: &'p [Chosen<'a>], dump: &Dump, most: u64) -> Vec<&'p [Chosen<'a>]> {
    let (mut cuts, mut bytes) = (vec![0], 0);
    for (number, pixel) in pixels.iter().enumerate() {
        let more = pixel.bytes(dump);
        if bytes + more > most && bytes > 0 {
            cuts.push(number);
            bytes = 0;
        }
        bytes += more;
    }
    cuts.push(pixels.len());
    cuts.windows(2).map(|ends| &pixels[ends[0]..ends[1]]).filter(|pixels| !pixels.is_empty()).collect()
}

/// Table of the records of each pixel, when those of all lie one behind the other.
fn table(
    gpu: &Gpu,
    dump: &Dump,
    pixels: &[Chosen<'_>],
    half: SampleSplit,
    part_length: usize,
) -> Result<ChunkTable, GatherError> {
    let (mut rows, mut parts, mut shards) = (Vec::new(), Vec::new(), Vec::new());
    let mut first = 0;
    for of_tile in pixels.chunk_by(|a, b| a.tile == b.tile) {
        let tile = of_tile[0].tile;
        let scale = 1.0 / half.tile_samples(dump, tile).max(1) as f32;
        let first_shard = shards.len() as u32;
        shards.extend(dump.tile(tile).map(|shard| GpuShard::new(shard)));
        for pixel in of_tile {
            rows.push(GpuPixel { image: pixel.place, first_part: parts.len() as u32, scale });
            let mut start = first as u32;
            for run in &pixel.runs {
                let end = start + run.records.len() as u32;
                parts.push(GpuPart { start, end, shard: first_shard + run.number });
                start = end;
            }
            first += pixel.room();
        }
    }
    Ok(ChunkTable::of(gpu, rows, &parts, &shards, part_length)?)
}

/// Brings the records of some pixels together and hands them over.
fn write(gpu: &Gpu, to: &ChunkRecords, pixels: &[Chosen<'_>]) {
    let columns: [fn(&Shard) -> &[u32]; 3] = [Shard::position_xy, Shard::position_z_flags, Shard::throughput];
    let parts = on_threads(pixels, |pixels| {
        columns.map(|of| pixels.iter().flat_map(|pixel| pixel.words(of)).collect::<Vec<_>>().concat())
    });
    let buffers = [&to.xy, &to.z_flags, &to.throughput];
    let mut first = 0;
    for part in parts {
        buffers.iter().zip(&part).for_each(|(to, words)| gpu.write(to, first, words));
        first += part[0].len();
    }
}

/// Does some work for runs of neighbours, each on a thread of its own. Not on those of the pool: while they wait they take up
/// other work, which may want a lock that the caller holds.
fn on_threads<T: Sync, R: Send>(items: &[T], work: impl Fn(&[T]) -> R + Sync) -> Vec<R> {
    let run = items.len().div_ceil(rayon::current_num_threads()).max(1);
    let work = &work;
    std::thread::scope(|scope| {
        let threads: Vec<_> = items.chunks(run).map(|items| scope.spawn(move || work(items))).collect();
        let result = |thread: std::thread::ScopedJoinHandle<'_, R>| {
            thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        threads.into_iter().map(result).collect()
    })
}

impl GpuGather {
    /// True if single pixels are gathered here, and smoothed lights: the dump stays on the device, or there is room to
    /// copy what is asked for.
    pub fn gathers_pixels(&self) -> bool {
        let numbers = self.pixel_count() * size_of::<u32>();
        self.is_resident() || self.gpu.free_memory() >= LEAST_ROOM + numbers as u64
    }

    /// Bytes of records that were copied to the device for single pixels, since the dump does not stay there.
    pub fn copied_bytes(&self) -> u64 {
        self.copied.load(Ordering::Relaxed)
    }

    pub(super) fn pixel_count(&self) -> usize {
        self.dump.manifest().width * self.dump.manifest().height
    }

    /// Submits the commands that `add` makes of the chunks that have some of these places in the image, from their records, their
    /// table and the numbers in that of the pixels by place (`number_of` of `shaders/gather/pixel.wgsl`).
    pub(super) fn each_chunk_of<'a>(
        &'a self,
        places: impl FnOnce() -> Vec<u32>,
        half: SampleSplit,
        add: impl Fn(&ChunkRecords, &ChunkTable, &Buffer<u32>) -> Result<Commands<'a>, GatherError>,
    ) -> Result<(), GatherError> {
        let Some(chunks) = &self.resident else { return self.copy_pixels(places(), half, add) };
        for chunk in chunks {
            let table = chunk.table(&self.gpu, &self.dump, half)?;
            let numbers = chunk.numbers(&self.gpu, &table, self.pixel_count())?;
            add(&chunk.records, &table, &numbers)?.submit()?;
        }
        Ok(())
    }

    /// [`GpuGather::each_chunk_of`] with chunks of nothing else, copied while the device works on those before.
    fn copy_pixels<'a>(
        &'a self,
        mut places: Vec<u32>,
        half: SampleSplit,
        add: impl Fn(&ChunkRecords, &ChunkTable, &Buffer<u32>) -> Result<Commands<'a>, GatherError>,
    ) -> Result<(), GatherError> {
        let mut last = self.last_copied.lock().unwrap_or_else(PoisonError::into_inner);
        // What the call before has copied makes room only when the device is done with it.
        if let Some(before) = last.take() {
            self.gpu.wait_for(before)?;
        }
        places.retain(|&place| (place as usize) < self.pixel_count());
        places.sort_unstable();
        places.dedup();
        let choose = |places: &[u32]| -> Vec<Chosen<'_>> {
            places.iter().map(|&place| Chosen::new(&self.dump, place, half)).collect()
        };
        let mut pixels: Vec<_> = on_threads(&places, choose).into_iter().flatten().collect();
        pixels.sort_by_key(|pixel| pixel.tile);
        let numbers = self.gpu.zeros("numbers of pixels", self.pixel_count())?;
        let place_bytes = (self.gpu.free_memory() as f64 * STREAM_SHARE) as u64 / STREAM_PLACES as u64;
        // Half of it: places have room for the most records of any chunk beside the largest table of any.
        let chunks = cut(&pixels, &self.dump, place_bytes.min(MOST_PENDING as u64 * RECORD_BYTES) / 2);
        let room_of = |pixels: &&[Chosen<'_>]| pixels.iter().map(Chosen::room).sum::<usize>();
        let room = chunks.iter().map(room_of).max().unwrap_or(0);
        *last = self.in_turns(&chunks, room, |place, pixels| {
            write(&self.gpu, place, pixels);
            self.copied.fetch_add(room_of(pixels) as u64 * RECORD_BYTES, Ordering::Relaxed);
            let table = table(&self.gpu, &self.dump, pixels, half, self.part_length)?;
            table.number(&self.gpu, &numbers)?;
            let submission = add(place, &table, &numbers)?.submit_tracked()?;
            Ok((table, submission))
        })?;
        Ok(())
    }
}
