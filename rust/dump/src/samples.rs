use glam::Vec3;

use crate::{End, Lobe, Segment, TileRect};

/// Values per pixel in the `aov` tensor of a shard; sums over the samples of its pass.
pub const AOV_CHANNELS: usize = 16;

/// First channel of each AOV within [`AOV_CHANNELS`]. The last channel is spare and 0.
pub mod aov_channel {
    /// Albedo, RGB.
    pub const ALBEDO: usize = 0;
    /// World-space shading normal.
    pub const NORMAL: usize = 3;
    /// Distance to the first hit in metres, summed over the samples that hit something.
    pub const DEPTH: usize = 6;
    /// Radiance of the scene's own emitters, RGB.
    pub const EMISSION: usize = 7;
    /// Radiance of the baked world, RGB.
    pub const WORLD: usize = 10;
    /// Film alpha.
    pub const ALPHA: usize = 13;
    /// Samples that hit something (the divisor of the depth).
    pub const HITS: usize = 14;
}

/// Contribution of one camera path to the AOVs.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AovSample {
    /// Albedo of the first non-specular hit, RGB.
    pub albedo: Vec3,
    /// World-space shading normal of the first non-specular hit; zero if nothing was hit.
    pub normal: Vec3,
    /// Distance from the camera to the first hit in metres; none if nothing was hit.
    pub depth: Option<f32>,
    /// Radiance of the scene's own emitters (static light) along the whole path, RGB.
    pub emission: Vec3,
    /// Radiance of the baked world along the whole path, camera rays included, RGB.
    pub world: Vec3,
    /// Film alpha: 0 where the camera sees through the scene.
    pub alpha: f32,
}

impl AovSample {
    /// Values in the order of [`aov_channel`].
    pub(crate) fn channels(&self) -> [f32; AOV_CHANNELS] {
        let [albedo, normal, emission, world] = [self.albedo, self.normal, self.emission, self.world];
        let depth = self.depth.unwrap_or(0.0);
        let hits = if self.depth.is_some() { 1.0 } else { 0.0 };
        [
            albedo.x, albedo.y, albedo.z, normal.x, normal.y, normal.z, depth, emission.x, emission.y,
            emission.z, world.x, world.y, world.z, self.alpha, hits, 0.0,
        ]
    }
}

/// One record before packing.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SampleRecord {
    pub end: End,
    pub throughput: Vec3,
    /// Lobe of the segment; none for an origin record.
    pub lobe: Option<Lobe>,
    pub receiver: u16,
    pub path_start: bool,
    pub continues: bool,
}

/// The samples of one tile and one pass, in memory, as the tracer makes them: pixels row by row from the top
/// left, and for each pixel its paths in the order of their sample numbers.
#[derive(Clone, Debug)]
pub struct TileSamples {
    rect: TileRect,
    /// First record of each pixel begun so far.
    pub(crate) pixel_starts: Vec<usize>,
    pub(crate) records: Vec<SampleRecord>,
    pub(crate) aov: Vec<[f32; AOV_CHANNELS]>,
    /// The last record is a placeholder, which the first record of the path replaces.
    path_is_empty: bool,
}

impl TileSamples {
    /// Empty samples of a tile.
    pub fn new(rect: TileRect) -> Self {
        Self { rect, pixel_starts: Vec::new(), records: Vec::new(), aov: Vec::new(), path_is_empty: false }
    }

    /// Empties them for another tile and keeps the memory.
    pub fn reset(&mut self, rect: TileRect) {
        self.rect = rect;
        self.pixel_starts.clear();
        self.records.clear();
        self.aov.clear();
        self.path_is_empty = false;
    }

    /// The tile.
    pub fn rect(&self) -> TileRect {
        self.rect
    }

    /// Pixels begun so far.
    pub fn pixel_count(&self) -> usize {
        self.aov.len()
    }

    /// Records so far, all pixels together.
    pub fn record_count(&self) -> usize {
        self.records.len()
    }

    /// Starts the next pixel.
    pub fn begin_pixel(&mut self) {
        self.path_is_empty = false;
        self.pixel_starts.push(self.records.len());
        self.aov.push([0.0; AOV_CHANNELS]);
    }

    /// Starts the next path of the current pixel; `camera_vertex` is where it starts unless the camera is a pinhole
    /// ([`crate::Manifest::camera_position`]). A path without segments counts as one that collects nothing.
    pub fn begin_path(&mut self, camera_vertex: Option<Vec3>) {
        let (end, lobe) = match camera_vertex {
            Some(vertex) => (End::Vertex(vertex), None),
            None => (End::Escape(Vec3::Z), Some(Lobe::Camera)),
        };
        self.path_is_empty = camera_vertex.is_none();
        self.records.push(SampleRecord {
            end,
            throughput: Vec3::ZERO,
            lobe,
            receiver: 0,
            path_start: true,
            continues: false,
        });
    }

    /// Appends a segment to the current path, whose first one is the camera's.
    pub fn push(&mut self, segment: Segment) {
        let Segment { end, throughput, lobe, receiver, continues } = segment;
        if self.path_is_empty {
            self.records.pop();
        }
        let path_start = std::mem::take(&mut self.path_is_empty);
        self.records.push(SampleRecord {
            end,
            throughput,
            lobe: Some(lobe),
            receiver,
            path_start,
            continues,
        });
    }

    /// Adds to the AOVs of the current pixel; once per path.
    pub fn add_aov(&mut self, sample: AovSample) {
        if let Some(sums) = self.aov.last_mut() {
            for (sum, value) in sums.iter_mut().zip(sample.channels()) {
                *sum += value;
            }
        }
    }
}
