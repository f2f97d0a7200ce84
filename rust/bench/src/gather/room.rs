//! A made-up dump, and lights in it.

use glam::Vec3;
use rayon::prelude::*;
use relume_dump::{
    Dump, DumpError, End, FORMAT_VERSION, Lobe, Manifest, MemoryWriter, Pass, Segment, ShardSink, TileSamples,
};
use relume_scene::{Light, LightShape, LobeFactors};

/// Bytes of a segment that are read where no light is hit.
pub const POSITION_BYTES: f64 = 8.0;
/// Edge of a tile of [`room`], pixels.
pub const TILE: usize = 16;
const SEGMENTS_PER_PATH: usize = 4;

pub fn light(shape: LightShape) -> Light {
    let lobes = LobeFactors::default();
    Light { name: "bench".into(), lobes, ..Light::unit(shape) }
}

/// Lights of the size of lamps in a room of 8 x 8 x 8 m.
pub fn sphere(index: usize) -> LightShape {
    let mut random = Random(100 + index as u64);
    LightShape::Sphere { center: random.point(3.0), radius: 0.2 }
}

/// Lights from which derivatives by a light's place are taken.
pub fn neighbour(index: usize) -> LightShape {
    let beside_camera = Vec3::new(1.0, 2.0, 1.0);
    LightShape::Sphere { center: beside_camera + Random(300 + index as u64).point(0.3), radius: 0.2 }
}

pub fn quad(index: usize) -> LightShape {
    let center = Random(200 + index as u64).point(3.0);
    LightShape::Quad { center, edge_u: Vec3::X * 0.5, edge_v: Vec3::Y * 0.5, spread: std::f32::consts::PI }
}

/// A made-up dump: paths between random points on the walls of a room, a few of which escape.
pub struct Room {
    pub width: usize,
    pub height: usize,
    /// Edge of a tile, pixels.
    pub tile: usize,
    /// Paths of a pixel.
    pub samples: usize,
    /// Segments of a path.
    pub segments: usize,
}

/// The smallest that has so many megabytes of positions.
pub fn room(megabytes: usize) -> Result<Dump, DumpError> {
    const SAMPLES: usize = 256;
    let bytes_per_tile = TILE * TILE * SAMPLES * SEGMENTS_PER_PATH * POSITION_BYTES as usize;
    let tiles = (megabytes << 20).div_ceil(bytes_per_tile).max(1);
    let (width, height, tile, samples, segments) = (TILE * tiles, TILE, TILE, SAMPLES, SEGMENTS_PER_PATH);
    Room { width, height, tile, samples, segments }.dump()
}

impl Room {
    pub fn dump(&self) -> Result<Dump, DumpError> {
        let manifest = Manifest {
            format_version: FORMAT_VERSION,
            scene_hash: "bench".into(),
            width: self.width,
            height: self.height,
            tile_size: self.tile,
            passes: vec![Pass { first_sample: 0, samples: self.samples as u32 }],
            seed: 0,
            camera: Default::default(),
            camera_position: Some([0.0; 3]),
            receivers: Vec::new(),
            classes: None,
            settings: Default::default(),
            working_space: String::new(),
            world_color: [1.0; 3],
            world_map: String::new(),
            recorded: None,
        };
        let writer = MemoryWriter::new(manifest.clone())?;
        let write = |tile| writer.write(tile, 0, &self.samples_of_tile(&manifest, tile));
        (0..manifest.tile_count()).into_par_iter().try_for_each(write)?;
        Ok(writer.snapshot())
    }

    fn samples_of_tile(&self, manifest: &Manifest, tile: usize) -> TileSamples {
        let mut random = Random(1 + ((tile as u64) << 32));
        let mut samples = TileSamples::new(manifest.tile_rect(tile));
        for _ in 0..samples.rect().pixel_count() {
            samples.begin_pixel();
            for _ in 0..self.samples {
                samples.begin_path(None);
                for depth in 0..self.segments {
                    let last = depth + 1 == self.segments && random.next() < 0.25;
                    let wall = random.point(1.0);
                    let end = match last {
                        true => End::Escape(wall.normalize_or(Vec3::Z)),
                        false => End::Vertex(wall / wall.abs().max_element().max(1e-3) * 4.0),
                    };
                    let lobe = if depth == 0 { Lobe::Camera } else { Lobe::Diffuse };
                    let throughput = Vec3::splat(0.5);
                    samples.push(Segment { end, throughput, lobe, receiver: 0, continues: false });
                }
            }
        }
        samples
    }
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / 16_777_216.0
    }

    fn point(&mut self, extent: f32) -> Vec3 {
        Vec3::from([(); 3].map(|()| (2.0 * self.next() - 1.0) * extent))
    }
}
