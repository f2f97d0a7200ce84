//! Writes small OpenVDB files for tests: what Blender does not write, and what no one should.

use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::IVec3;
use half::f16;
use std::collections::BTreeMap;
use std::io::Write;

pub const ZIP: u32 = 1;
pub const ACTIVE_MASK: u32 = 2;
pub const BLOSC: u32 = 4;

/// Numbers of a grid's type, as bytes.
#[derive(Clone, Copy, PartialEq)]
pub enum Numbers {
    Half,
    Float,
    Double,
    Int32,
}

impl Numbers {
    fn bytes(self, value: f32) -> Vec<u8> {
        match self {
            Self::Half => f16::from_f32(value).to_le_bytes().to_vec(),
            Self::Float => value.to_le_bytes().to_vec(),
            Self::Double => f64::from(value).to_le_bytes().to_vec(),
            Self::Int32 => (value as i32).to_le_bytes().to_vec(),
        }
    }
}

/// A value, and if it is active.
type Voxel = ([f32; 3], bool);
/// Values of a leaf, along z first.
pub type Leaf = Vec<Voxel>;

/// A grid as it is written.
#[derive(Clone)]
pub struct TestGrid {
    pub unique_name: String,
    pub tree_type: &'static str,
    pub numbers: Numbers,
    pub channels: usize,
    /// Floats of nodes are written as halves.
    pub is_half: bool,
    pub instance_of: &'static str,
    pub map: &'static str,
    pub map_numbers: Vec<f64>,
    pub compression: u32,
    pub background: f32,
    /// By their bricks.
    pub leaves: BTreeMap<[i32; 3], Leaf>,
    /// Tiles of the lower level, a brick each: value, and if it is active.
    pub small_tiles: BTreeMap<[i32; 3], (f32, bool)>,
    /// Tiles of the upper level, by their lowest bricks, 16 bricks wide.
    pub large_tiles: BTreeMap<[i32; 3], (f32, bool)>,
    /// Tiles of the root, by their lowest voxels.
    pub root_tiles: Vec<([i32; 3], f32, bool)>,
}

impl TestGrid {
    /// A grid of floats without voxels, whose index space is object space.
    pub fn new(name: &str) -> Self {
        Self {
            unique_name: name.into(),
            tree_type: "Tree_float_5_4_3",
            numbers: Numbers::Float,
            channels: 1,
            is_half: false,
            instance_of: "",
            map: "UniformScaleMap",
            map_numbers: scale([1.0; 3]),
            compression: ACTIVE_MASK,
            background: 0.0,
            leaves: BTreeMap::new(),
            small_tiles: BTreeMap::new(),
            large_tiles: BTreeMap::new(),
            root_tiles: Vec::new(),
        }
    }

    /// Fills a brick with the values of a function of the voxel; voxels without one are background.
    pub fn with_leaf(mut self, brick: [i32; 3], value: impl Fn(IVec3) -> Option<[f32; 3]>) -> Self {
        let background = [self.background; 3];
        let leaf = voxels(brick).map(|voxel| value(voxel).map_or((background, false), |found| (found, true)));
        self.leaves.insert(brick, leaf.collect());
        self
    }

    fn value(&self, value: [f32; 3]) -> Vec<u8> {
        value[..self.channels].iter().flat_map(|number| self.numbers.bytes(*number)).collect()
    }

    fn tree(&self) -> Vec<u8> {
        let keys = self.leaves.keys().chain(self.small_tiles.keys());
        let mut lower: Vec<[i32; 3]> = keys.map(|brick| brick.map(|step| step >> 4 << 4)).collect();
        let root_of = |node: &[i32; 3]| node.map(|step| step >> 9 << 9);
        lower.sort_by_key(|node| (root_of(node), *node));
        lower.dedup();
        let roots = lower.iter().chain(self.large_tiles.keys()).map(root_of);
        let mut roots: Vec<[i32; 3]> = roots.collect();
        roots.sort();
        roots.dedup();
        let mut out = 1_i32.to_le_bytes().to_vec();
        out.extend(self.value([self.background; 3]));
        out.extend((self.root_tiles.len() as u32).to_le_bytes());
        out.extend((roots.len() as u32).to_le_bytes());
        for (origin, value, is_active) in &self.root_tiles {
            out.extend(origin.iter().flat_map(|step| step.to_le_bytes()));
            out.extend(self.value([*value; 3]));
            out.push(u8::from(*is_active));
        }
        for root in roots {
            out.extend(root.iter().flat_map(|step| (step * 8).to_le_bytes()));
            let children: Vec<[i32; 3]> =
                lower.iter().copied().filter(|node| root_of(node) == root).collect();
            out.extend(self.node(root, 5, 16, &children, &self.large_tiles));
            for node in children {
                let own = |brick: &&[i32; 3]| brick.map(|step| step >> 4 << 4) == node;
                let leaves: Vec<[i32; 3]> = self.leaves.keys().filter(own).copied().collect();
                out.extend(self.node(node, 4, 1, &leaves, &self.small_tiles));
                leaves.iter().for_each(|leaf| out.extend(mask(&self.leaves[leaf])));
            }
        }
        // Leaves in the order of nodes, not of bricks.
        for node in lower {
            for (_, leaf) in self.leaves.iter().filter(|(brick, _)| brick.map(|step| step >> 4 << 4) == node)
            {
                out.extend(mask(leaf));
                out.extend(self.values(leaf));
            }
        }
        out
    }

    fn node(
        &self,
        origin: [i32; 3],
        level: usize,
        edge: i32,
        children: &[[i32; 3]],
        tiles: &BTreeMap<[i32; 3], (f32, bool)>,
    ) -> Vec<u8> {
        let side = 1 << level;
        let place = |child: usize| {
            [child / (side * side), child / side % side, child % side].map(|step| step as i32 * edge)
        };
        let bricks = (0..side * side * side)
            .map(|child| std::array::from_fn(|axis| origin[axis] + place(child)[axis]));
        let bricks: Vec<[i32; 3]> = bricks.collect();
        let is_child: Leaf = bricks.iter().map(|brick| ([0.0; 3], children.contains(brick))).collect();
        let background = (self.background, false);
        let values: Leaf = bricks
            .iter()
            .map(|brick| *tiles.get(brick).unwrap_or(&background))
            .map(|(value, is_active)| ([value; 3], is_active))
            .collect();
        [mask(&is_child), mask(&values), self.values(&values)].concat()
    }

    /// Values of a node behind the byte that tells of its inactive ones, as OpenVDB chooses it.
    fn values(&self, values: &[Voxel]) -> Vec<u8> {
        let background = [self.background; 3];
        let negative = background.map(|channel| -channel);
        let mut others: Vec<[f32; 3]> = Vec::new();
        for (value, is_active) in values {
            if !is_active && !others.contains(value) {
                others.push(*value);
            }
        }
        others.sort_by_key(|value| *value == background);
        let kind: u8 = match &others[..] {
            _ if self.compression & ACTIVE_MASK == 0 => 6,
            [] => 0,
            [one] if *one == background => 0,
            [one] if *one == negative => 1,
            [_] => 2,
            [one, two] if *two == background && *one == negative => 3,
            [_, two] if *two == background => 4,
            [_, _] => 5,
            _ => 6,
        };
        let mut out = vec![kind];
        let stored = match kind {
            2 | 4 => 1,
            5 => 2,
            _ => 0,
        };
        others[..stored].iter().for_each(|value| out.extend(self.value(*value)));
        if (3..=5).contains(&kind) {
            let is_second: Leaf =
                values.iter().map(|(value, is_active)| (*value, !is_active && *value == others[1])).collect();
            out.extend(mask(&is_second));
        }
        let numbers = if self.is_half { Numbers::Half } else { self.numbers };
        let written = values.iter().filter(|(_, is_active)| kind == 6 || *is_active);
        let bytes: Vec<u8> = written
            .flat_map(|(value, _)| {
                value[..self.channels].iter().flat_map(move |number| numbers.bytes(*number))
            })
            .collect();
        if bytes.is_empty() && self.is_half {
            return out;
        }
        let packed = match self.compression & (ZIP | BLOSC) {
            ZIP => zip(&bytes),
            BLOSC => blosc(&bytes),
            _ => {
                out.extend(bytes);
                return out;
            }
        };
        if packed.len() < bytes.len() {
            out.extend((packed.len() as i64).to_le_bytes());
            out.extend(packed);
        } else {
            out.extend((-(bytes.len() as i64)).to_le_bytes());
            out.extend(bytes);
        }
        out
    }
}

/// A scale and the four vectors that follow it in a map.
pub fn scale(scale: [f64; 3]) -> Vec<f64> {
    [&scale[..], &[0.0; 12]].concat()
}

fn voxels(brick: [i32; 3]) -> impl Iterator<Item = IVec3> {
    let corner = IVec3::from_array(brick) * 8;
    (0..512).map(move |place| corner + IVec3::new(place >> 6, place >> 3 & 7, place & 7))
}

fn mask(values: &[Voxel]) -> Vec<u8> {
    let byte = |eight: &[Voxel]| {
        eight.iter().enumerate().map(|(bit, (_, is_on))| u8::from(*is_on) << bit).sum::<u8>()
    };
    values.chunks(8).map(byte).collect()
}

fn zip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A chunk of Blosc of one block: bytes of floats shuffled and split, each stream as LZ4.
pub fn blosc(bytes: &[u8]) -> Vec<u8> {
    let values = bytes.len() / 4;
    let shuffled: Vec<u8> =
        (0..4).flat_map(|plane| (0..values).map(move |value| bytes[4 * value + plane])).collect();
    let shuffled = [&shuffled[..], &bytes[4 * values..]].concat();
    let is_split = bytes.len() >= 4 * 128 && bytes.len().is_multiple_of(4);
    let flags = 0x1 | 1 << 5 | if is_split { 0 } else { 0x10 };
    let streams: Vec<&[u8]> = if is_split { shuffled.chunks(values).collect() } else { vec![&shuffled[..]] };
    let mut body = 20_u32.to_le_bytes().to_vec();
    for stream in streams {
        let packed = lz4_flex::block::compress(stream);
        let packed = if packed.len() < stream.len() { &packed[..] } else { stream };
        body.extend((packed.len() as u32).to_le_bytes());
        body.extend(packed);
    }
    let length = (bytes.len() as u32).to_le_bytes();
    let whole = ((16 + body.len()) as u32).to_le_bytes();
    [&[2, 1, flags, 4][..], &length, &length, &whole, &body].concat()
}

fn string(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

/// The bytes of a file.
pub fn file(version: u32, grids: &[TestGrid]) -> Vec<u8> {
    let mut out = 0x5644_4220_i64.to_le_bytes().to_vec();
    out.extend(version.to_le_bytes());
    out.extend([13_u32, 0].into_iter().flat_map(u32::to_le_bytes));
    out.push(1);
    out.extend([b'0'; 36]);
    out.extend(metadata("creator", "string", b"a test"));
    out.extend((grids.len() as i32).to_le_bytes());
    for grid in grids {
        out.extend(string(&grid.unique_name));
        let suffix = if grid.is_half { "_HalfFloat" } else { "" };
        out.extend(string(&format!("{}{suffix}", grid.tree_type)));
        out.extend(string(grid.instance_of));
        let mut data = grid.compression.to_le_bytes().to_vec();
        data.extend(metadata("is_saved_as_half_float", "bool", &[u8::from(grid.is_half)]));
        data.extend(string(grid.map));
        data.extend(grid.map_numbers.iter().flat_map(|number| number.to_le_bytes()));
        if grid.instance_of.is_empty() {
            data.extend(grid.tree());
        }
        let start = (out.len() + 24) as i64;
        out.extend([start, start, start + data.len() as i64].into_iter().flat_map(i64::to_le_bytes));
        out.extend(data);
    }
    out
}

fn metadata(name: &str, kind: &str, value: &[u8]) -> Vec<u8> {
    let value = [&(value.len() as u32).to_le_bytes()[..], value].concat();
    [1_u32.to_le_bytes().to_vec(), string(name), string(kind), value].concat()
}
