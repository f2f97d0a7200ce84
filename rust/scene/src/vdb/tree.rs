use super::input::Input;
use super::values::{Value, ValueReader, has_bit};
use crate::grid::BRICK;
use glam::IVec3;

/// Children along an edge of a node of the upper and of the lower level, as powers of 2.
const UPPER: u32 = 5;
const LOWER: u32 = 4;
/// Edges of what the children of a node cover, in bricks; a leaf is one brick.
const ROOT_CHILD: i32 = 1 << (UPPER + LOWER);
const UPPER_CHILD: i32 = 1 << LOWER;
const LEAF_MASK: usize = BRICK * BRICK * BRICK / 8;

/// A cube of one value.
pub(super) struct Tile {
    /// Lowest brick.
    pub origin: IVec3,
    /// Edge in bricks.
    pub edge: i32,
    pub value: Value,
    pub is_active: bool,
}

/// Facts of a tree that are known while its topology is read.
pub(super) trait Visitor {
    /// A tile that is active, or differs from the background.
    fn tile(&mut self, tile: Tile) -> Result<(), String>;
    /// A leaf, by its brick. Leaves come in the order in which their values follow the topology.
    fn leaf(&mut self, brick: IVec3) -> Result<(), String>;
}

/// Reads the topology of a tree and leaves the input where the values of its leaves begin.
pub(super) fn read_topology(
    input: &mut Input,
    reader: &mut ValueReader,
    visitor: &mut impl Visitor,
) -> Result<(), String> {
    let _buffers = input.i32()?;
    reader.background = reader.value_type.read(input)?;
    let [tiles, children] = [input.u32()?, input.u32()?];
    let mut last = None;
    for _ in 0..tiles {
        let origin = read_origin(input)?;
        check_order(&mut last, origin)?;
        let value = reader.value_type.read(input)?;
        let is_active = input.byte()? != 0;
        show_tile(reader, visitor, Tile { origin, edge: ROOT_CHILD, value, is_active })?;
    }
    last = None;
    for _ in 0..children {
        let origin = read_origin(input)?;
        check_order(&mut last, origin)?;
        read_node(input, reader, visitor, UPPER, origin)?;
    }
    Ok(())
}

/// Origins must rise: values of leaves follow in their order, and none may come twice.
fn check_order(last: &mut Option<[i32; 3]>, origin: IVec3) -> Result<(), String> {
    let is_later = last.replace(origin.to_array()).is_none_or(|last| last < origin.to_array());
    if is_later { Ok(()) } else { Err("its nodes are not in order; it is damaged".into()) }
}

/// Origin of a child of the root, in bricks.
fn read_origin(input: &mut Input) -> Result<IVec3, String> {
    let voxel = IVec3::new(input.i32()?, input.i32()?, input.i32()?);
    let brick = voxel >> BRICK.trailing_zeros();
    let is_aligned = (voxel & (ROOT_CHILD * BRICK as i32 - 1)) == IVec3::ZERO;
    if is_aligned { Ok(brick) } else { Err("a node lies where none can; it is damaged".into()) }
}

fn read_node(
    input: &mut Input,
    reader: &ValueReader,
    visitor: &mut impl Visitor,
    level: u32,
    origin: IVec3,
) -> Result<(), String> {
    let children = 1 << (3 * level);
    let child_mask = input.take(children / 8)?;
    let active = input.take(children / 8)?;
    let mut values = vec![Value::default(); children];
    reader.read(input, active, &mut values)?;
    let edge = if level == UPPER { UPPER_CHILD } else { 1 };
    // Along z first.
    let place = |child: usize| {
        let (child, side) = (child as i32, (1 << level) - 1);
        origin + edge * IVec3::new(child >> (2 * level), child >> level & side, child & side)
    };
    for (child, &value) in values.iter().enumerate() {
        if !has_bit(child_mask, child) {
            let tile = Tile { origin: place(child), edge, value, is_active: has_bit(active, child) };
            show_tile(reader, visitor, tile)?;
        }
    }
    drop(values);
    for child in (0..children).filter(|child| has_bit(child_mask, *child)) {
        if level == UPPER {
            read_node(input, reader, visitor, LOWER, place(child))?;
        } else {
            // The mask stands before the values once more.
            input.take(LEAF_MASK)?;
            visitor.leaf(place(child))?;
        }
    }
    Ok(())
}

fn show_tile(reader: &ValueReader, visitor: &mut impl Visitor, tile: Tile) -> Result<(), String> {
    let is_background = tile.value.map(f32::to_bits) == reader.background.map(f32::to_bits);
    if is_background && !tile.is_active { Ok(()) } else { visitor.tile(tile) }
}

/// Reads the values of a leaf, along z first, and the mask of those that are active.
pub(super) fn read_leaf<'a>(
    input: &mut Input<'a>,
    reader: &ValueReader,
    values: &mut [Value],
) -> Result<&'a [u8], String> {
    let active = input.take(LEAF_MASK)?;
    reader.read(input, active, values)?;
    Ok(active)
}
