use super::header::GridHead;
use super::input::Input;
use super::tree::{Tile, Visitor, read_leaf, read_topology};
use super::values::{Value, ValueReader, has_bit};
use crate::grid::{BRICK_VOXELS, Bricks, Grid, check_size};
use glam::IVec3;
use std::collections::{HashMap, HashSet};

/// Reads the tree that `input` stands before. Scalars up to `clipping` become the background.
pub(super) fn read_grid(
    name: &str,
    input: &Input,
    head: &GridHead,
    mut reader: ValueReader,
    clipping: f32,
) -> Result<Grid, String> {
    let channels = reader.value_type.channels;
    let mut extent = Extent { channels, ..Extent::default() };
    read_topology(&mut input.clone(), &mut reader, &mut extent)?;
    extent.check()?;
    let mut input = input.clone();
    let clipping = if channels == 1 { clipping } else { f32::NEG_INFINITY };
    let mut fill = Fill::new(name, head, &extent, clipping);
    read_topology(&mut input, &mut reader, &mut fill)?;
    fill.set_background(reader.background);
    let mut values = [Value::default(); BRICK_VOXELS];
    for number in 0..fill.leaves.len() {
        let active = read_leaf(&mut input, &reader, &mut values)?;
        fill.set_leaf(number, active, &values, reader.background);
    }
    Ok(fill.grid)
}

/// Size of a tree, which says what memory it takes.
#[derive(Default)]
struct Extent {
    channels: usize,
    box_of_bricks: Option<[IVec3; 2]>,
    leaves: usize,
    tile_values: HashSet<[u32; 3]>,
}

impl Extent {
    fn include(&mut self, low: IVec3, high: IVec3) {
        let [lowest, highest] = self.box_of_bricks.unwrap_or([low, high]);
        self.box_of_bricks = Some([lowest.min(low), highest.max(high)]);
    }

    fn bricks(&self) -> Bricks {
        match self.box_of_bricks {
            Some([low, high]) => Bricks { origin: low, counts: (high - low + 1).as_uvec3() },
            None => Bricks::default(),
        }
    }

    /// Number of bricks that have values of their own; the first is of background.
    fn slots(&self) -> usize {
        1 + self.leaves + self.tile_values.len()
    }

    fn check(&self) -> Result<(), String> {
        check_size(&self.bricks(), self.slots(), self.channels)
    }
}

impl Visitor for Extent {
    fn tile(&mut self, tile: Tile) -> Result<(), String> {
        self.include(tile.origin, tile.origin + (tile.edge - 1));
        // Each value takes a brick: how many there may be is known before they are counted to the end.
        if self.tile_values.insert(tile.value.map(f32::to_bits)) { self.check() } else { Ok(()) }
    }

    fn leaf(&mut self, brick: IVec3) -> Result<(), String> {
        self.include(brick, brick);
        self.leaves += 1;
        Ok(())
    }
}

/// A grid that is being filled.
struct Fill {
    grid: Grid,
    leaves: Vec<IVec3>,
    tile_slots: HashMap<[u32; 3], u32>,
    first_tile_slot: usize,
    clipping: f32,
}

impl Fill {
    fn new(name: &str, head: &GridHead, extent: &Extent, clipping: f32) -> Self {
        let bricks = extent.bricks();
        let grid = Grid {
            name: name.to_owned(),
            channels: extent.channels,
            object_from_index: head.object_from_index,
            bricks,
            active: None,
            slots: vec![0; bricks.len()],
            values: vec![0.0; extent.slots() * BRICK_VOXELS * extent.channels],
        };
        let leaves = Vec::with_capacity(extent.leaves);
        Self { grid, leaves, tile_slots: HashMap::new(), first_tile_slot: 1 + extent.leaves, clipping }
    }

    /// Fills the bricks of one value, now that the background is known.
    fn set_background(&mut self, background: Value) {
        self.set_brick(0, |_| background);
        for (value, slot) in std::mem::take(&mut self.tile_slots) {
            let value = value.map(f32::from_bits);
            let value = if is_clipped(value, self.clipping) { background } else { value };
            self.set_brick(slot as usize, |_| value);
        }
    }

    fn set_brick(&mut self, slot: usize, value: impl Fn(usize) -> Value) {
        let channels = self.grid.channels;
        let size = BRICK_VOXELS * channels;
        let voxels = self.grid.values[slot * size..][..size].chunks_exact_mut(channels);
        for (place, voxel) in voxels.enumerate() {
            voxel.copy_from_slice(&value(place)[..channels]);
        }
    }

    fn set_leaf(&mut self, number: usize, active: &[u8], values: &[Value], background: Value) {
        let clipping = self.clipping;
        self.set_brick(1 + number, |place| {
            if is_clipped(values[place], clipping) { background } else { values[place] }
        });
        let is_active = |place: usize| has_bit(active, place) && !is_clipped(values[place], clipping);
        self.grid.include_active(self.leaves[number], is_active);
    }
}

/// True if a scalar becomes background.
fn is_clipped(value: Value, clipping: f32) -> bool {
    value[0] <= clipping
}

impl Visitor for Fill {
    fn tile(&mut self, tile: Tile) -> Result<(), String> {
        let next = self.first_tile_slot + self.tile_slots.len();
        let slot = *self.tile_slots.entry(tile.value.map(f32::to_bits)).or_insert(next as u32);
        let high = tile.origin + (tile.edge - 1);
        for x in tile.origin.x..=high.x {
            for y in tile.origin.y..=high.y {
                let start = self.grid.bricks.index(IVec3::new(x, y, tile.origin.z));
                self.grid.slots[start..][..tile.edge as usize].fill(slot);
            }
        }
        if tile.is_active && !is_clipped(tile.value, self.clipping) {
            self.grid.include_active_bricks(tile.origin, high);
        }
        Ok(())
    }

    fn leaf(&mut self, brick: IVec3) -> Result<(), String> {
        let slot = 1 + self.leaves.len();
        let index = self.grid.bricks.index(brick);
        self.grid.slots[index] = slot as u32;
        self.leaves.push(brick);
        Ok(())
    }
}
