use std::ops::Range;
use std::sync::{Arc, OnceLock};

use bytemuck::{Pod, Zeroable};
use relume_dump::{Dump, Shard};
use relume_gpu::{Binding, Buffer, Gpu, GpuError};

use super::arguments::NumbersArguments;
use super::kernels::{self, GROUP_SIZE};
use crate::SampleSplit;

/// Bytes of a record on the device.
pub const RECORD_BYTES: u64 = 12;

/// Records that are handed to the device at once: 64 MiB. The driver keeps a copy until they are there.
pub const MOST_PENDING: usize = (64 << 20) / RECORD_BYTES as usize;

/// Shards, or pieces of them, that are gathered in one run, those of a tile side by side.
#[derive(Clone, Debug, Default)]
pub struct ChunkPlan {
    pieces: Vec<Piece>,
    pub records: usize,
}

/// Some of the pixels of a shard in a chunk, mostly all of them.
#[derive(Clone, Debug)]
struct Piece {
    tile: usize,
    shard: Arc<Shard>,
    pixels: Range<usize>,
    /// Number of its first record in the chunk.
    first: usize,
}

impl Piece {
    /// Range of its records in the shard.
    fn records(&self) -> Range<usize> {
        let offsets = self.shard.pixel_offsets();
        offsets[self.pixels.start] as usize..offsets[self.pixels.end] as usize
    }

    /// Iterates over its records in runs of at most so many.
    fn runs(&self, most: usize) -> impl Iterator<Item = Range<usize>> {
        let records = self.records();
        records.clone().step_by(most).map(move |start| start..records.end.min(start.saturating_add(most)))
    }
}

/// Pixels of a shard in runs of at most so many records, or of a single pixel that has more.
fn runs(shard: &Shard, records: usize) -> impl Iterator<Item = Range<usize>> + '_ {
    let offsets = shard.pixel_offsets();
    let (mut start, pixels) = (0, shard.rect().pixel_count());
    std::iter::from_fn(move || {
        let most = (offsets[start] as usize).saturating_add(records);
        let fitting = offsets[start..].partition_point(|&offset| offset as usize <= most) - 1;
        let run = start..start + fitting.max(1);
        start = run.end;
        (run.end <= pixels).then_some(run)
    })
}

impl ChunkPlan {
    /// Cuts a dump into chunks of at most so many records, or of a single pixel that has more. Shards are cut if they have more.
    pub fn cut(dump: &Dump, records: usize) -> Vec<Self> {
        let mut plans: Vec<Self> = Vec::new();
        for tile in 0..dump.manifest().tile_count() {
            for shard in dump.tile(tile) {
                for pixels in runs(shard, records) {
                    let mut piece = Piece { tile, shard: Arc::clone(shard), pixels, first: 0 };
                    let count = piece.records().len();
                    if plans.last().is_none_or(|plan| plan.records + count > records) {
                        plans.push(Self::default());
                    }
                    // There is one: see above.
                    let plan = plans.last_mut().expect("a plan");
                    piece.first = plan.records;
                    plan.pieces.push(piece);
                    plan.records += count;
                }
            }
        }
        plans
    }

    /// The pieces of each tile, with the number of the first of them, and the pixels that they have.
    fn tiles(&self) -> impl Iterator<Item = (usize, &[Piece], Range<usize>)> {
        let mut first = 0;
        self.pieces.chunk_by(|a, b| a.tile == b.tile).map(move |pieces| {
            first += pieces.len();
            let start = pieces.iter().map(|piece| piece.pixels.start).min().unwrap_or(0);
            let end = pieces.iter().map(|piece| piece.pixels.end).max().unwrap_or(0);
            (first - pieces.len(), pieces, start..end)
        })
    }
}

/// The records of a chunk on the device.
#[derive(Debug)]
pub struct ChunkRecords {
    pub(super) xy: Buffer<u32>,
    pub(super) z_flags: Buffer<u32>,
    pub(super) throughput: Buffer<u32>,
}

impl ChunkRecords {
    /// Room for so many records, and the three more that the last load of four may touch.
    pub fn new(gpu: &Gpu, records: usize) -> Result<Self, GpuError> {
        let room = |what| gpu.zeros(what, records.next_multiple_of(4));
        Ok(Self {
            xy: room("positions of the dump")?,
            z_flags: room("positions and flags of the dump")?,
            throughput: room("throughputs of the dump")?,
        })
    }

    /// Replaces the records, once the device has done what was submitted before.
    ///
    /// # Errors
    /// If the device was lost.
    pub fn write(&self, gpu: &Gpu, plan: &ChunkPlan) -> Result<(), GpuError> {
        self.write_in_runs(gpu, plan, MOST_PENDING)
    }

    /// [`ChunkRecords::write`] with copies of at most three times so many records on the CPU: while the device takes one run, the
    /// next is copied.
    fn write_in_runs(&self, gpu: &Gpu, plan: &ChunkPlan, most: usize) -> Result<(), GpuError> {
        let (mut pending, mut under_way) = (0, None);
        for piece in &plan.pieces {
            for records in piece.runs(most) {
                pending += records.len();
                self.write_run(gpu, piece, records);
                if pending >= most {
                    pending = 0;
                    if let Some(before) = under_way.replace(gpu.submit_writes()?) {
                        gpu.wait_for(before)?;
                    }
                }
            }
        }
        Ok(())
    }

    fn write_run(&self, gpu: &Gpu, piece: &Piece, records: Range<usize>) {
        let (shard, first) = (&piece.shard, piece.first + records.start - piece.records().start);
        gpu.write(&self.xy, first, &shard.position_xy()[records.clone()]);
        gpu.write(&self.z_flags, first, &shard.position_z_flags()[records.clone()]);
        gpu.write(&self.throughput, first, &shard.throughput()[records]);
    }
}

/// `Shard` of `shaders/gather/shard.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct GpuShard {
    step: [f32; 4],
    minimum: [f32; 4],
    camera: [f32; 4],
}

impl GpuShard {
    pub fn new(shard: &Shard) -> Self {
        let four = |[x, y, z]: [f32; 3]| [x, y, z, 0.0];
        Self {
            step: four(shard.grid().step().into()),
            minimum: four(shard.grid().min.into()),
            camera: four(shard.camera_position().into()),
        }
    }
}

/// `Pixel` of `shaders/gather/row.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct GpuPixel {
    pub image: u32,
    pub first_part: u32,
    pub scale: f32,
}

/// `Part` of `shaders/gather/records.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct GpuPart {
    pub start: u32,
    pub end: u32,
    pub shard: u32,
}

impl Piece {
    /// The records of a pixel of the tile; none if it has none here. `shard` is the number of the piece.
    fn part(&self, pixel: usize, half: SampleSplit, shard: u32) -> Option<GpuPart> {
        let records = self.pixels.contains(&pixel).then(|| half.records(&self.shard, pixel))?;
        let place = |record: usize| (self.first + record - self.records().start) as u32;
        let (start, end) = (place(records.start), place(records.end));
        (start < end).then_some(GpuPart { start, end, shard })
    }
}

/// Places in the image, row by row, of some pixels of a tile.
fn places(dump: &Dump, tile: usize, pixels: Range<usize>) -> impl Iterator<Item = u32> {
    let (rect, width) = (dump.manifest().tile_rect(tile), dump.manifest().width);
    let place = move |pixel| (rect.y + pixel / rect.width) * width + rect.x + pixel % rect.width;
    pixels.map(move |pixel| place(pixel) as u32)
}

/// Table of the records of a chunk by pixel.
#[derive(Debug)]
pub struct ChunkTable {
    shards: Buffer<GpuShard>,
    pixels: Buffer<GpuPixel>,
    parts: Buffer<GpuPart>,
    pub pixel_count: u32,
    /// Mean records of a part.
    pub part_length: usize,
}

impl ChunkTable {
    pub fn new(gpu: &Gpu, dump: &Dump, plan: &ChunkPlan, half: SampleSplit) -> Result<Self, GpuError> {
        let (mut pixels, mut parts) = (Vec::new(), Vec::new());
        for (first_shard, pieces, tile_pixels) in plan.tiles() {
            let tile = pieces[0].tile;
            let scale = 1.0 / half.tile_samples(dump, tile).max(1) as f32;
            for (pixel, image) in tile_pixels.clone().zip(places(dump, tile, tile_pixels)) {
                pixels.push(GpuPixel { image, first_part: parts.len() as u32, scale });
                for (piece, number) in pieces.iter().zip(first_shard as u32..) {
                    parts.extend(piece.part(pixel, half, number));
                }
            }
        }
        let shards: Vec<_> = plan.pieces.iter().map(|piece| GpuShard::new(&piece.shard)).collect();
        let part_length = plan.records / parts.len().max(1);
        Self::of(gpu, pixels, &parts, &shards, part_length)
    }

    /// The table of some pixels, whose parts follow each other.
    pub(super) fn of(
        gpu: &Gpu,
        mut pixels: Vec<GpuPixel>,
        parts: &[GpuPart],
        shards: &[GpuShard],
        part_length: usize,
    ) -> Result<Self, GpuError> {
        let pixel_count = pixels.len() as u32;
        pixels.push(GpuPixel { image: 0, first_part: parts.len() as u32, scale: 0.0 });
        Ok(Self {
            shards: gpu.buffer_of("shards", shards)?,
            pixels: gpu.buffer_of("pixels", &pixels)?,
            parts: gpu.buffer_of("parts of pixels", parts)?,
            pixel_count,
            part_length,
        })
    }

    /// Notes the numbers of its pixels by their places in the image, for kernels that look for single ones.
    pub fn number(&self, gpu: &Gpu, numbers: &Buffer<u32>) -> Result<(), GpuError> {
        let bound = kernels::numbers(gpu)?.bind(&[self.pixels.whole(), numbers.whole()])?;
        let mut commands = gpu.commands("numbers of pixels");
        let arguments = NumbersArguments { pixels: self.pixel_count };
        commands.run(&bound, self.pixel_count.div_ceil(GROUP_SIZE), bytemuck::bytes_of(&arguments));
        commands.submit()
    }

    /// Bytes of the table of a chunk.
    pub fn bytes(plan: &ChunkPlan) -> u64 {
        let pixels: usize = plan.tiles().map(|(_, _, pixels)| pixels.len()).sum();
        let parts: usize = plan.pieces.iter().map(|piece| piece.pixels.len()).sum();
        ((pixels + 1) * size_of::<GpuPixel>()
            + parts * size_of::<GpuPart>()
            + plan.pieces.len() * size_of::<GpuShard>()) as u64
    }

    /// Bindings 2 to 6 of `shaders/gather/records.wgsl`.
    pub fn bindings<'a>(&'a self, records: &'a ChunkRecords) -> [Binding<'a>; 5] {
        [
            records.xy.whole(),
            records.z_flags.whole(),
            records.throughput.whole(),
            self.pixels.whole(),
            self.parts.whole(),
        ]
    }

    /// Bindings 2 to 7 of `shaders/gather/pixel.wgsl`.
    pub fn bindings_and_shards<'a>(&'a self, records: &'a ChunkRecords) -> impl Iterator<Item = Binding<'a>> {
        self.bindings(records).into_iter().chain([self.shards.whole()])
    }
}

/// All paths, and either half of them.
const TABLES: usize = 3;

/// A chunk that stays on the device.
#[derive(Debug)]
pub struct GpuChunk {
    plan: ChunkPlan,
    pub records: ChunkRecords,
    /// Tables by half, made when first asked for.
    tables: [OnceLock<Arc<ChunkTable>>; TABLES],
    /// Numbers by place in the image, made when first asked for.
    numbers: OnceLock<Arc<Buffer<u32>>>,
}

impl GpuChunk {
    pub fn new(gpu: &Gpu, plan: ChunkPlan) -> Result<Self, GpuError> {
        let records = ChunkRecords::new(gpu, plan.records)?;
        records.write(gpu, &plan)?;
        Ok(Self { plan, records, tables: Default::default(), numbers: OnceLock::new() })
    }

    /// Bytes that a chunk may take besides its records once all has been asked for: a table for each half, and numbers.
    pub fn most_bytes_beside(plan: &ChunkPlan, dump: &Dump) -> u64 {
        let numbers = dump.manifest().width * dump.manifest().height * size_of::<u32>();
        TABLES as u64 * ChunkTable::bytes(plan) + numbers as u64
    }

    pub fn table(&self, gpu: &Gpu, dump: &Dump, half: SampleSplit) -> Result<Arc<ChunkTable>, GpuError> {
        let known = &self.tables[half as usize];
        if let Some(table) = known.get() {
            return Ok(Arc::clone(table));
        }
        let table = Arc::new(ChunkTable::new(gpu, dump, &self.plan, half)?);
        Ok(Arc::clone(known.get_or_init(|| table)))
    }

    /// The numbers of the pixels in `table`, which are the same in all of its tables, by place in an image of so many pixels.
    pub fn numbers(
        &self,
        gpu: &Gpu,
        table: &ChunkTable,
        pixels: usize,
    ) -> Result<Arc<Buffer<u32>>, GpuError> {
        if let Some(numbers) = self.numbers.get() {
            return Ok(Arc::clone(numbers));
        }
        let numbers = Arc::new(gpu.zeros("numbers of pixels", pixels)?);
        table.number(gpu, &numbers)?;
        Ok(Arc::clone(self.numbers.get_or_init(|| numbers)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::kernels::random_dump_of;

    #[test]
    fn chunks_hold_every_record_once_and_no_more_than_asked() {
        let dump = random_dump_of(10, &[1, 3, 40]);
        let longest = dump
            .shards()
            .flat_map(|shard| (0..shard.rect().pixel_count()).map(|p| shard.pixel(p).len()))
            .max();
        for most in [longest.unwrap(), 1000, 2000, usize::MAX] {
            let plans = ChunkPlan::cut(&dump, most);
            assert!(plans.iter().all(|plan| plan.records <= most));
            assert!((most == usize::MAX) == (plans.len() == 1));
            let pieces = || plans.iter().flat_map(|plan| &plan.pieces);
            for shard in dump.shards() {
                let of_shard = || pieces().filter(|piece| Arc::ptr_eq(&piece.shard, shard));
                let records: Vec<_> = of_shard().flat_map(Piece::records).collect();
                assert!(records.iter().copied().eq(0..shard.record_count()));
                assert!(shard.record_count() > most || of_shard().count() == 1, "cut without need");
            }
        }
        // A pixel is not cut.
        assert!(ChunkPlan::cut(&dump, 1).iter().all(|plan| plan.pieces.len() <= 1 || plan.records <= 1));
    }

    #[test]
    fn records_are_the_same_however_few_are_written_at_once() {
        let gpu = Gpu::open(&relume_gpu::GpuChoice::Best).expect("tests need a GPU or a software driver");
        let dump = random_dump_of(10, &[1, 3, 40]);
        let plan = &ChunkPlan::cut(&dump, usize::MAX)[0];
        let written = |most: usize| {
            let runs: Vec<_> = plan.pieces.iter().flat_map(|piece| piece.runs(most)).collect();
            assert!(runs.iter().all(|run| run.len() <= most));
            let records = ChunkRecords::new(&gpu, plan.records).unwrap();
            records.write_in_runs(&gpu, plan, most).unwrap();
            let read = |buffer: &Buffer<u32>| gpu.read(buffer, 0..plan.records).unwrap();
            (runs.len(), [&records.xy, &records.z_flags, &records.throughput].map(read))
        };
        let (shards, whole) = written(usize::MAX);
        let all =
            |words: fn(&Shard) -> &[u32]| dump.shards().flat_map(|shard| words(shard)).copied().collect();
        let expected: [Vec<u32>; 3] =
            [all(Shard::position_xy), all(Shard::position_z_flags), all(Shard::throughput)];
        assert_eq!(whole, expected);
        for most in [100, 7, 1] {
            let (runs, found) = written(most);
            assert!(runs > 2 * shards, "{runs} runs");
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn tables_have_the_layout_of_their_wgsl_twins() {
        relume_gpu::assert_mirror!(GpuShard as "gather/shard", "Shard", { step, minimum, camera });
        relume_gpu::assert_mirror!(GpuPixel as "gather/row", "Pixel", { image, first_part, scale });
        relume_gpu::assert_mirror!(GpuPart as "gather/records", "Part", { start, end, shard });
    }
}
