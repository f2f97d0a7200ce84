use std::io::Write;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::{DumpError, SegmentClasses};

/// Version of the manifest and of the shards; a reader refuses any other.
pub const FORMAT_VERSION: u32 = 7;

/// Description of a dump: written once as `manifest.json`, the same for all machines that bake tiles of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT_VERSION`].
    pub format_version: u32,
    /// Hash of the exported scene, hex.
    pub scene_hash: String,
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Edge of the square tiles in pixels; tiles at the right and lower edge are cut off.
    pub tile_size: usize,
    /// Sampling passes over the image, in order, without gaps.
    pub passes: Vec<Pass>,
    /// Seed of the sampler.
    pub seed: u64,
    /// The camera, as the session serialises it.
    pub camera: serde_json::Value,
    /// Start of every path of a pinhole camera, world space, metres; absent if paths carry their own camera vertex
    /// (depth of field, orthographic, clip start).
    pub camera_position: Option<[f32; 3]>,
    /// Object names by receiver number (light linking); may be empty.
    pub receivers: Vec<String>,
    /// Classes of segments for lights with rules of their own; absent where no light had any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub classes: Option<SegmentClasses>,
    /// Settings that made the dump: bounces, clamps and so on.
    pub settings: serde_json::Value,
    /// Name of the scene-linear space of all colours.
    pub working_space: String,
    /// Radiance of the world that the AOV `world` is of, or the factor on its texture; RGB.
    pub world_color: [f32; 3],
    /// Hash of that world's texture and how it is turned, hex. The paths are right for any world.
    pub world_map: String,
    /// Lower and upper corner of the box, in metres of world space, beyond which no path was recorded; absent unless all
    /// space is filled with a medium.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<[[f32; 3]; 2]>,
}

/// A range of samples of every pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pass {
    /// First sample number.
    pub first_sample: u32,
    /// Samples, that is paths, per pixel; at least 1.
    pub samples: u32,
}

/// A rectangle of pixels; x to the right, y downwards from the top left pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct TileRect {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl TileRect {
    /// Number of pixels.
    pub fn pixel_count(&self) -> usize {
        self.width * self.height
    }

    /// Its pixels, row by row.
    pub fn pixels(self) -> impl Iterator<Item = (usize, usize)> {
        let columns = self.x..self.x + self.width;
        (self.y..self.y + self.height).flat_map(move |y| columns.clone().map(move |x| (x, y)))
    }
}

impl Manifest {
    /// File name of the manifest in the dump's folder.
    pub const FILE: &'static str = "manifest.json";

    /// Name that [`Manifest::difference`] gives to another [`Manifest::world_map`], where nothing else differs.
    pub const WORLD_MAP: &'static str = "map of the world";

    /// Columns of tiles.
    pub fn tiles_x(&self) -> usize {
        self.width.div_ceil(self.tile_size)
    }

    /// Number of tiles.
    pub fn tile_count(&self) -> usize {
        self.tiles_x() * self.height.div_ceil(self.tile_size)
    }

    /// Pixels of a tile; tiles count row by row from the top left.
    pub fn tile_rect(&self, tile: usize) -> TileRect {
        let x = tile % self.tiles_x() * self.tile_size;
        let y = tile / self.tiles_x() * self.tile_size;
        let (width, height) = (self.tile_size.min(self.width - x), self.tile_size.min(self.height - y));
        TileRect { x, y, width, height }
    }

    /// Number of receiver numbers, classes included; 0 if receivers are not known.
    pub fn receiver_count(&self) -> usize {
        self.receivers.len().saturating_mul(self.classes.as_ref().map_or(1, SegmentClasses::count))
    }

    /// First receiver number of segments along which no world is seen.
    pub fn first_without_world(&self) -> u16 {
        let first = |classes: &SegmentClasses| classes.first_without_world() * self.receivers.len();
        self.classes.as_ref().map_or(crate::RECEIVER_LIMIT, |classes| first(classes) as u16)
    }

    /// Samples per pixel over all passes.
    pub fn samples(&self) -> u32 {
        self.passes.iter().map(|pass| pass.samples).sum()
    }

    /// File of a shard in the dump's folder.
    pub fn shard_path(dir: &Path, tile: usize, pass: usize) -> PathBuf {
        dir.join(format!("tile_{tile:04}_pass_{pass:04}.safetensors"))
    }

    /// Refuses values that no dump can have.
    pub fn check(&self) -> Result<(), DumpError> {
        const SIZE_LIMIT: usize = 1 << 16;
        /// Readers keep a list of all shards.
        const SHARD_LIMIT: usize = 1 << 24;
        let fail = |reason: String| Err(DumpError::Manifest(reason));
        if self.format_version != FORMAT_VERSION {
            return fail(format!(
                "format version {} instead of {FORMAT_VERSION}; use the Relume that wrote it or bake again",
                self.format_version
            ));
        }
        for (name, size) in [("width", self.width), ("height", self.height), ("tile size", self.tile_size)] {
            if size == 0 || size > SIZE_LIMIT {
                return fail(format!("{name} is {size}, must be 1 to {SIZE_LIMIT} pixels"));
            }
        }
        let mut next = self.passes.first().map_or(0, |pass| pass.first_sample);
        for (index, pass) in self.passes.iter().enumerate() {
            let end = pass.first_sample.checked_add(pass.samples);
            if pass.samples == 0 || pass.first_sample != next || end.is_none() {
                return fail(format!("pass {index} has no samples or does not follow the one before"));
            }
            next = pass.first_sample + pass.samples;
        }
        if self.passes.is_empty() {
            return fail("no passes".into());
        }
        if self.tile_count().saturating_mul(self.passes.len()) > SHARD_LIMIT {
            return fail(format!("more than {SHARD_LIMIT} shards; use larger tiles"));
        }
        if self.camera_position.is_some_and(|p| !p.iter().all(|v| v.is_finite())) {
            return fail("the camera position is not finite".into());
        }
        if self.world_color.iter().any(|channel| !channel.is_finite()) {
            return fail("the colour of the world is not finite".into());
        }
        let classes = self.classes.as_ref().map_or(1, SegmentClasses::count);
        if self.receiver_count().max(classes) > usize::from(crate::RECEIVER_LIMIT) {
            return fail(format!("more than {} receivers", crate::RECEIVER_LIMIT));
        }
        Ok(())
    }

    /// The first thing in which `other` is a bake of something else; more or fewer samples are the same bake as
    /// long as they are divided into the same passes, of which a last one may hold just what is left.
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        [
            ("format version", self.format_version == other.format_version),
            ("scene", self.scene_hash == other.scene_hash),
            ("image size", (self.width, self.height) == (other.width, other.height)),
            ("tile size", self.tile_size == other.tile_size),
            ("sample range of a pass", self.is_divided_as(other)),
            ("seed", self.seed == other.seed),
            ("camera", (&self.camera, self.camera_position) == (&other.camera, other.camera_position)),
            ("receiver list", self.receivers == other.receivers),
            ("rules of lights", self.classes == other.classes),
            ("settings", self.settings == other.settings),
            ("working space", self.working_space == other.working_space),
            ("colour of the world", self.world_color == other.world_color),
            (Self::WORLD_MAP, self.world_map == other.world_map),
        ]
        .into_iter()
        .find_map(|(name, same)| (!same).then_some(name))
    }

    fn is_divided_as(&self, other: &Self) -> bool {
        let ends_in = |passes: &[Pass], index: usize| index + 1 == passes.len();
        self.passes.iter().zip(&other.passes).enumerate().all(|(index, (a, b))| {
            let is_rest = if a.samples < b.samples {
                ends_in(&self.passes, index)
            } else {
                ends_in(&other.passes, index)
            };
            a == b || (a.first_sample == b.first_sample && is_rest)
        })
    }

    /// Hash of everything but the passes, hex; every shard carries it, so that files of different bakes cannot mix.
    pub fn bake_id(&self) -> String {
        let without_passes = Self { passes: Vec::new(), ..self.clone() };
        let json = serde_json::to_vec(&without_passes).expect("plain data with string keys");
        blake3::hash(&json).to_hex().to_string()
    }

    /// Reads and checks the manifest of a folder.
    pub fn read(dir: &Path) -> Result<Self, DumpError> {
        let path = dir.join(Self::FILE);
        let json = std::fs::read(&path).map_err(DumpError::io("read the dump's manifest", &path))?;
        Self::from_bytes(&path, &json)
    }

    /// Reads and checks a manifest from bytes that nobody vouches for; `name` stands in messages. Never panics.
    pub fn from_bytes(name: &Path, json: &[u8]) -> Result<Self, DumpError> {
        let manifest: Self =
            serde_json::from_slice(json).map_err(|error| DumpError::damaged(name, error.to_string()))?;
        manifest.check().map_err(|error| DumpError::damaged(name, error.to_string()))?;
        Ok(manifest)
    }

    /// True if a folder holds a manifest of another format version than ours.
    pub fn is_of_another_version(dir: &Path) -> bool {
        let value: Option<serde_json::Value> =
            std::fs::read(dir.join(Self::FILE)).ok().and_then(|json| serde_json::from_slice(&json).ok());
        let version = value.and_then(|value| value.get("format_version")?.as_u64());
        version.is_some_and(|version| version != u64::from(FORMAT_VERSION))
    }

    /// Writes the manifest atomically.
    pub fn write(&self, dir: &Path) -> Result<(), DumpError> {
        let path = dir.join(Self::FILE);
        let mut json = serde_json::to_vec_pretty(self).expect("plain data with string keys");
        json.push(b'\n');
        relume_image::replace_file(&path, |writer| writer.write_all(&json))
            .map_err(DumpError::io("write", &path))
    }
}
