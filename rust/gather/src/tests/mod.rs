//! Tests on hand-built dumps.

mod closed_form;
mod denoise;
mod images;
pub mod kernels;
pub mod pieces;
mod soft;

use std::sync::Arc;

use glam::{Mat3, Quat, Vec3};
use relume_dump::{
    Dump, End, FORMAT_VERSION, Lobe, Manifest, MemoryWriter, Pass, Segment, ShardSink, TileSamples,
    encode_rgb9e5,
};
use relume_scene::{EmissionMap, Falloff, Light, LightShape, MapDomain, PlacedMap};

/// A manifest of square images with tiles of 4 pixels.
pub fn manifest(size: usize, samples: &[u32]) -> Manifest {
    let mut first_sample = 0;
    let passes = samples.iter().map(|&samples| {
        first_sample += samples;
        Pass { first_sample: first_sample - samples, samples }
    });
    Manifest {
        format_version: FORMAT_VERSION,
        scene_hash: String::new(),
        width: size,
        height: size,
        tile_size: 4,
        passes: passes.collect(),
        seed: 0,
        camera: serde_json::Value::Null,
        camera_position: Some([0.0, 0.0, 5.0]),
        receivers: Vec::new(),
        classes: None,
        settings: serde_json::Value::Null,
        working_space: "Linear Rec.709".into(),
        world_color: [1.0; 3],
        world_map: String::new(),
        recorded: None,
    }
}

/// A dump in memory; `path` makes the segments of each path from its pixel, sample number and samples.
pub fn dump(manifest: Manifest, mut path: impl FnMut(usize, u32, &mut TileSamples)) -> Dump {
    let writer = MemoryWriter::new(manifest.clone()).unwrap();
    for tile in 0..manifest.tile_count() {
        for (index, pass) in manifest.passes.iter().enumerate() {
            let rect = manifest.tile_rect(tile);
            let mut samples = TileSamples::new(rect);
            for pixel in 0..rect.pixel_count() {
                let (x, y) = (rect.x + pixel % rect.width, rect.y + pixel / rect.width);
                samples.begin_pixel();
                for sample in 0..pass.samples {
                    samples.begin_path(None);
                    path(y * manifest.width + x, pass.first_sample + sample, &mut samples);
                }
            }
            writer.write(tile, index, &samples).unwrap();
        }
    }
    writer.snapshot()
}

/// A segment of throughput 1 in all channels.
pub fn segment(end: End, lobe: Lobe) -> Segment {
    Segment { end, throughput: Vec3::ONE, lobe, receiver: 0, continues: false }
}

/// A light of radiance 1.
pub fn light(shape: LightShape) -> Light {
    Light { name: "Lamp".into(), ..Light::unit(shape) }
}

/// The light with a random map, mild enough for what directions are rounded to.
pub fn mapped(light: &Light, random: &mut Random, domain: MapDomain) -> Light {
    let falloff = Falloff { power: random.range(0.0, 2.0), smooth: random.next() };
    let texel = |_| encode_rgb9e5(Vec3::splat(0.5) + random.point(0.4), Vec3::splat(0.5));
    let map = EmissionMap { domain, width: 8, texels: (0..8 * 5).map(texel).collect(), falloff };
    let local_from_world = Mat3::from_quat(Quat::from_scaled_axis(random.point(2.0)));
    Light { map: Some(PlacedMap { map: Arc::new(map), local_from_world }), ..light.clone() }
}

/// A small random generator (SplitMix64), uniform in 0..1.
pub struct Random(pub u64);

impl Random {
    /// The next number.
    pub fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ z >> 31) >> 40) as f32 / 16_777_216.0
    }

    /// A number in a range.
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next()
    }

    /// A point in a cube around the origin.
    pub fn point(&mut self, extent: f32) -> Vec3 {
        Vec3::new(self.range(-extent, extent), self.range(-extent, extent), self.range(-extent, extent))
    }
}
