use std::sync::{Arc, OnceLock};

use bytemuck::{Pod, Zeroable};
use relume_dump::{Dump, Shard};
use relume_gpu::{Binding, Buffer, Gpu, GpuError};

use crate::Half;

/// Bytes of a record on the device.
pub const RECORD_BYTES: u64 = 12;

/// Whole shards that are gathered in one run, those of a tile side by side.
#[derive(Clone, Debug, Default)]
pub struct ChunkPlan {
    shards: Vec<Placed>,
    pub records: usize,
}

/// A shard in a chunk.
#[derive(Clone, Debug)]
struct Placed {
    tile: usize,
    shard: Arc<Shard>,
    /// Number of its first record in the chunk.
    first: u32,
}

impl ChunkPlan {
    /// Cuts a dump into chunks of at most so many records, or of a single shard if that has more.
    pub fn cut(dump: &Dump, records: usize) -> Vec<Self> {
        let mut plans: Vec<Self> = Vec::new();
        for tile in 0..dump.manifest().tile_count() {
            for shard in dump.tile(tile) {
                let count = shard.record_count();
                if plans.last().is_none_or(|plan| plan.records + count > records) {
                    plans.push(Self::default());
                }
                // There is one: see above.
                let plan = plans.last_mut().expect("a plan");
                plan.shards.push(Placed { tile, shard: Arc::clone(shard), first: plan.records as u32 });
                plan.records += count;
            }
        }
        plans
    }

    /// The shards of each tile, with the number of the first of them.
    fn tiles(&self) -> impl Iterator<Item = (usize, &[Placed])> {
        let mut first = 0;
        self.shards.chunk_by(|a, b| a.tile == b.tile).map(move |shards| {
            first += shards.len();
            (first - shards.len(), shards)
        })
    }
}

/// The records of a chunk on the device.
#[derive(Debug)]
pub struct ChunkRecords {
    xy: Buffer<u32>,
    z_flags: Buffer<u32>,
    throughput: Buffer<u32>,
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
    pub fn write(&self, gpu: &Gpu, plan: &ChunkPlan) {
        for Placed { shard, first, .. } in &plan.shards {
            let first = *first as usize;
            gpu.write(&self.xy, first, shard.position_xy());
            gpu.write(&self.z_flags, first, shard.position_z_flags());
            gpu.write(&self.throughput, first, shard.throughput());
        }
    }
}

/// `Shard` of `shaders/gather/pixel.wgsl`.
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

/// `Pixel` of `shaders/gather/pixel.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct GpuPixel {
    image: u32,
    first_part: u32,
    scale: f32,
}

/// `Part` of `shaders/gather/pixel.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct GpuPart {
    start: u32,
    end: u32,
    shard: u32,
}

/// Places in the image, row by row, of the pixels of a tile.
fn places(dump: &Dump, tile: usize) -> impl Iterator<Item = u32> {
    let (rect, width) = (dump.manifest().tile_rect(tile), dump.manifest().width);
    let place = move |pixel| (rect.y + pixel / rect.width) * width + rect.x + pixel % rect.width;
    (0..rect.pixel_count()).map(move |pixel| place(pixel) as u32)
}

/// Which records of a chunk belong to which pixel.
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
    pub fn new(gpu: &Gpu, dump: &Dump, plan: &ChunkPlan, half: Half) -> Result<Self, GpuError> {
        let (mut pixels, mut parts) = (Vec::new(), Vec::new());
        for (first_shard, shards) in plan.tiles() {
            let tile = shards[0].tile;
            let scale = 1.0 / half.tile_samples(dump, tile).max(1) as f32;
            for (pixel, image) in places(dump, tile).enumerate() {
                pixels.push(GpuPixel { image, first_part: parts.len() as u32, scale });
                for (number, Placed { shard, first, .. }) in shards.iter().enumerate() {
                    let records = half.records(shard, pixel);
                    if !records.is_empty() {
                        let [start, end] = [records.start, records.end].map(|record| first + record as u32);
                        parts.push(GpuPart { start, end, shard: (first_shard + number) as u32 });
                    }
                }
            }
        }
        let pixel_count = pixels.len() as u32;
        pixels.push(GpuPixel { image: 0, first_part: parts.len() as u32, scale: 0.0 });
        let shards: Vec<_> = plan.shards.iter().map(|placed| GpuShard::new(&placed.shard)).collect();
        Ok(Self {
            shards: gpu.buffer_of("shards", &shards)?,
            pixels: gpu.buffer_of("pixels", &pixels)?,
            parts: gpu.buffer_of("parts of pixels", &parts)?,
            pixel_count,
            part_length: plan.records / parts.len().max(1),
        })
    }

    /// Bytes of the table of a chunk.
    pub fn bytes(plan: &ChunkPlan) -> u64 {
        let pixels: usize = plan.tiles().map(|(_, shards)| shards[0].shard.rect().pixel_count()).sum();
        let parts: usize = plan.shards.iter().map(|placed| placed.shard.rect().pixel_count()).sum();
        ((pixels + 1) * size_of::<GpuPixel>()
            + parts * size_of::<GpuPart>()
            + plan.shards.len() * size_of::<GpuShard>()) as u64
    }

    /// Bindings 2 to 7 of `shaders/gather/pixel.wgsl`.
    pub fn bindings<'a>(&'a self, records: &'a ChunkRecords) -> [Binding<'a>; 6] {
        [
            records.xy.whole(),
            records.z_flags.whole(),
            records.throughput.whole(),
            self.shards.whole(),
            self.pixels.whole(),
            self.parts.whole(),
        ]
    }
}

/// A chunk that stays on the device.
#[derive(Debug)]
pub struct Chunk {
    plan: ChunkPlan,
    pub records: ChunkRecords,
    /// By half, made when first asked for.
    tables: [OnceLock<Arc<ChunkTable>>; 3],
    /// By place in the image, made when first asked for.
    numbers: OnceLock<Arc<Buffer<u32>>>,
}

impl Chunk {
    pub fn new(gpu: &Gpu, plan: ChunkPlan) -> Result<Self, GpuError> {
        let records = ChunkRecords::new(gpu, plan.records)?;
        records.write(gpu, &plan);
        Ok(Self { plan, records, tables: Default::default(), numbers: OnceLock::new() })
    }

    pub fn table(&self, gpu: &Gpu, dump: &Dump, half: Half) -> Result<Arc<ChunkTable>, GpuError> {
        let known = &self.tables[half as usize];
        if let Some(table) = known.get() {
            return Ok(Arc::clone(table));
        }
        let table = Arc::new(ChunkTable::new(gpu, dump, &self.plan, half)?);
        Ok(Arc::clone(known.get_or_init(|| table)))
    }

    /// The number of each pixel in the tables by its place in the image; the largest for those of other chunks.
    pub fn numbers(&self, gpu: &Gpu, dump: &Dump) -> Result<Arc<Buffer<u32>>, GpuError> {
        if let Some(numbers) = self.numbers.get() {
            return Ok(Arc::clone(numbers));
        }
        let mut numbers = vec![u32::MAX; dump.manifest().width * dump.manifest().height];
        let places = self.plan.tiles().flat_map(|(_, shards)| places(dump, shards[0].tile));
        places.zip(0..).for_each(|(place, number)| numbers[place as usize] = number);
        let numbers = Arc::new(gpu.buffer_of("numbers of pixels", &numbers)?);
        Ok(Arc::clone(self.numbers.get_or_init(|| numbers)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_have_the_layout_of_their_wgsl_twins() {
        relume_gpu::assert_mirror!(GpuShard as "gather/pixel", "Shard", { step, minimum, camera });
        relume_gpu::assert_mirror!(GpuPixel as "gather/pixel", "Pixel", { image, first_part, scale });
        relume_gpu::assert_mirror!(GpuPart as "gather/pixel", "Part", { start, end, shard });
    }
}
