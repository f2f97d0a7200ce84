//! Sorts the segments of a group of pixels into blocks that lie close together, so that a light touches few of them.

use std::sync::Arc;

use relume_dump::{Dump, Flags, Shard, decode_direction};

use super::bounds::{Aabb, BoundsFrame, SegmentBounds, SegmentEnds};
use crate::SampleSplit;

/// Segments of a block (`shaders/gather/blocks.wgsl`).
pub const BLOCK: usize = 64;
/// Side of a group of pixels: the more segments are sorted together, the closer those of a block are.
const GROUP_SIDE: usize = 16;
/// Most shards of a tile: their number has seven bits.
pub const MOST_SHARDS: usize = 128;
/// `position_z_flags` of an origin record, which is no segment.
const NOTHING: u32 = 7 << 18;

/// Segments that are sorted apart: those from the camera, those to other vertices, those that escape, and the latter two
/// again where they continue a ray.
const CLASSES: usize = 5;
const ESCAPES: usize = 2;
/// First of the classes whose segments continue a ray, and what is added for these.
const CONTINUING: usize = 3;
const TO_CONTINUING: usize = 2;

/// Pixels of a tile whose segments are sorted together.
#[derive(Clone, Copy, Debug)]
pub struct PixelGroup {
    pub tile: usize,
    /// First column and row in the tile.
    x: usize,
    y: usize,
    pub width: usize,
    height: usize,
}

/// The segments of a group as the device has them (`shaders/gather/blocks.wgsl`), whole blocks of them.
#[derive(Debug, Default)]
pub struct Blocks {
    pub segments: Vec<[u32; 4]>,
    pub throughput: Vec<u32>,
    pub bounds: Vec<SegmentBounds>,
    /// Last segments that continue a ray: metres from where that began to where they start.
    pub behind: Vec<f32>,
}

/// Numbers of blocks.
#[derive(Clone, Copy, Debug)]
pub struct BlockCount {
    pub all: usize,
    /// The last ones, of segments that continue a ray.
    pub continuing: usize,
}

#[derive(Clone, Copy)]
struct Item {
    ends: SegmentEnds,
    words: [u32; 4],
    throughput: u32,
    behind: f32,
}

impl PixelGroup {
    /// Most segments that fill blocks up.
    pub const PADDING: usize = CLASSES * BLOCK;

    /// The groups of a dump, tile by tile.
    pub fn all(dump: &Dump) -> impl Iterator<Item = Self> + '_ {
        (0..dump.manifest().tile_count()).flat_map(|tile| {
            let rect = dump.manifest().tile_rect(tile);
            let starts = |length: usize| (0..length).step_by(GROUP_SIDE);
            let group = move |x, y| {
                let (width, height) = (GROUP_SIDE.min(rect.width - x), GROUP_SIDE.min(rect.height - y));
                Self { tile, x, y, width, height }
            };
            starts(rect.height).flat_map(move |y| starts(rect.width).map(move |x| group(x, y)))
        })
    }

    pub fn pixel_count(&self) -> usize {
        self.width * self.height
    }

    /// Place of the first pixel in the image, row by row.
    pub fn place(&self, dump: &Dump) -> usize {
        let rect = dump.manifest().tile_rect(self.tile);
        (rect.y + self.y) * dump.manifest().width + rect.x + self.x
    }

    /// Number in the tile of a pixel of the group.
    fn tile_pixel(&self, dump: &Dump, pixel: usize) -> usize {
        (self.y + pixel / self.width) * dump.manifest().tile_rect(self.tile).width
            + self.x
            + pixel % self.width
    }

    /// Most segments that its blocks can have, those that fill blocks up included.
    pub fn room(&self, dump: &Dump) -> usize {
        let records = |(shard, pixel): (&Arc<Shard>, usize)| shard.pixel(self.tile_pixel(dump, pixel)).len();
        let shards = dump.tile(self.tile).flat_map(|shard| (0..self.pixel_count()).map(move |p| (shard, p)));
        shards.map(records).sum::<usize>() + Self::PADDING
    }

    /// Numbers of blocks that its segments make up.
    pub fn block_count(&self, dump: &Dump) -> BlockCount {
        let mut segments = [0; CLASSES];
        for shard in dump.tile(self.tile) {
            for pixel in 0..self.pixel_count() {
                let flags = &shard.position_z_flags()[shard.pixel(self.tile_pixel(dump, pixel))];
                let classes = flags.iter().filter_map(|&z_flags| class(flags_of(z_flags)));
                classes.for_each(|class| segments[class] += 1);
            }
        }
        let blocks = segments.map(|count: usize| count.div_ceil(BLOCK));
        BlockCount { all: blocks.iter().sum(), continuing: blocks[CONTINUING..].iter().sum() }
    }

    /// Sorts the segments.
    pub fn sort(&self, dump: &Dump, frame: &BoundsFrame) -> Blocks {
        let mut classes = [const { Vec::new() }; CLASSES];
        for (number, shard) in dump.tile(self.tile).enumerate() {
            for pixel in 0..self.pixel_count() {
                let tile_pixel = self.tile_pixel(dump, pixel);
                let second = SampleSplit::Second.records(shard, tile_pixel);
                for record in shard.pixel(tile_pixel) {
                    let half = u32::from(second.contains(&record));
                    let place = (pixel as u32) << 16 | (number as u32) << 24 | half << 31;
                    if let Some((class, item)) = item(shard, record, place) {
                        classes[class].push(item);
                    }
                }
            }
        }
        let mut blocks = Blocks::default();
        for (class, items) in classes.iter_mut().enumerate() {
            let continuing = class >= CONTINUING;
            let escape = [ESCAPES, ESCAPES + TO_CONTINUING].contains(&class);
            // Directions weigh like distances across the scene.
            let end_weight = if escape { frame.diagonal() } else { 1.0 };
            split(items, end_weight, &mut |items| {
                blocks.push(items, escape, frame);
                if continuing {
                    blocks.behind.extend(items.iter().map(|item| item.behind));
                    blocks.behind.resize(blocks.behind.len().next_multiple_of(BLOCK), 0.0);
                }
            });
        }
        blocks
    }
}

/// Flags in a word of a shard.
fn flags_of(z_flags: u32) -> Flags {
    Flags((z_flags >> 16) as u16)
}

/// The class of a record, if it is a segment.
fn class(flags: Flags) -> Option<usize> {
    flags.lobe()?;
    let class = if flags.escaped() { ESCAPES } else { usize::from(!flags.starts_at_camera()) };
    Some(if flags.continues() { class + TO_CONTINUING } else { class })
}

/// A record and its class, if it is a segment; `place` is what is added to the last word.
fn item(shard: &Shard, record: usize, place: u32) -> Option<(usize, Item)> {
    let (xy, z_flags) = (shard.position_xy(), shard.position_z_flags());
    let flags = flags_of(z_flags[record]);
    let class = class(flags)?;
    // The first record of a shard starts a path.
    let before = record.saturating_sub(1);
    let position = |record: usize| {
        let grid = [xy[record] as u16, (xy[record] >> 16) as u16, z_flags[record] as u16];
        shard.grid().decode(grid)
    };
    let start = if flags.starts_at_camera() { shard.camera_position() } else { position(before) };
    let end = match flags.escaped() {
        true => {
            let direction = decode_direction(xy[record]);
            direction / direction.abs().element_sum()
        }
        false => position(record),
    };
    let words = [xy[record], z_flags[record], xy[before], z_flags[before] & 0xffff | place];
    let behind = if flags.continues() { shard.ray_origin(record).distance(start) } else { 0.0 };
    Some((
        class,
        Item { ends: SegmentEnds { start, end }, words, throughput: shard.throughput()[record], behind },
    ))
}

/// Halves segments along the widest side of their bounds until they make up a block.
fn split(items: &mut [Item], end_weight: f32, take: &mut impl FnMut(&mut [Item])) {
    if items.len() <= BLOCK {
        if !items.is_empty() {
            take(items);
        }
        return;
    }
    let [starts, ends] = Aabb::around(items.iter().map(|item| &item.ends));
    let (of_starts, of_ends) = (starts.high - starts.low, (ends.high - ends.low) * end_weight);
    let by_start = of_starts.max_element() >= of_ends.max_element();
    let axis = if by_start { of_starts } else { of_ends }.max_position();
    let key = |item: &Item| if by_start { item.ends.start[axis] } else { item.ends.end[axis] };
    // Only the last block of all is not full.
    let middle = (items.len() / 2).next_multiple_of(BLOCK).min((items.len() - 1) / BLOCK * BLOCK);
    items.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    let (lower, upper) = items.split_at_mut(middle);
    split(lower, end_weight, take);
    split(upper, end_weight, take);
}

impl Blocks {
    fn push(&mut self, items: &mut [Item], escape: bool, frame: &BoundsFrame) {
        // Those of one pixel side by side: what neighbours add to one place can be added up before it is added there.
        items.sort_unstable_by_key(|item| item.words[3] >> 16 & 255);
        let bounds = Aabb::around(items.iter().map(|item| &item.ends));
        self.bounds.push(SegmentBounds::new(bounds, escape, frame));
        self.segments.extend(items.iter().map(|item| item.words));
        self.throughput.extend(items.iter().map(|item| item.throughput));
        self.segments.resize(self.bounds.len() * BLOCK, [0, NOTHING, 0, 0]);
        self.throughput.resize(self.segments.len(), 0);
    }
}
