use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;
use relume_image::Image;

use crate::samples::{AOV_CHANNELS, aov_channel};
use crate::{DumpError, Manifest, Shard, ShardHeader, TileRect};

/// A path dump: the shards that there are so far. Cloning shares them.
#[derive(Clone, Debug)]
pub struct Dump {
    manifest: Arc<Manifest>,
    /// [`Manifest::bake_id`], which every shard is compared with.
    bake_id: Arc<str>,
    /// Shards by tile, then by pass.
    shards: Vec<Vec<Option<Arc<Shard>>>>,
}

/// Sums of the per-pixel features over the first passes of a dump: a dump that grows is not summed from its start again.
#[derive(Clone, Debug, Default)]
pub struct AovSums {
    passes: usize,
    /// Samples by tile.
    samples: Vec<u32>,
    /// Sums by place in the image, row by row.
    sums: Vec<[f32; AOV_CHANNELS]>,
}

/// Per-pixel features, averaged over all samples so far.
#[derive(Clone, Debug)]
pub struct Aovs {
    /// RGB.
    pub albedo: Image,
    /// World space, 3 channels; shorter than 1 where it varies within the pixel.
    pub normal: Image,
    /// Distance to the first hit in metres, 1 channel; 0 where nothing was hit.
    pub depth: Image,
    /// Radiance of the scene's own emitters, RGB.
    pub emission: Image,
    /// Radiance of the baked world, RGB.
    pub world: Image,
    /// Film alpha, 1 channel.
    pub alpha: Image,
}

impl Dump {
    /// A dump without shards, for samples that stay in memory.
    ///
    /// # Errors
    /// If the manifest is invalid.
    pub fn in_memory(manifest: Manifest) -> Result<Self, DumpError> {
        manifest.check()?;
        let shards = vec![vec![None; manifest.passes.len()]; manifest.tile_count()];
        let bake_id = manifest.bake_id().into();
        Ok(Self { manifest: Arc::new(manifest), bake_id, shards })
    }

    /// Opens a folder and maps the shards that there are; an unfinished dump is fine, see [`Dump::missing`].
    ///
    /// # Errors
    /// If the manifest or the structure of a shard is damaged, or a shard belongs to another bake. The content is
    /// not read: see [`Dump::validate`].
    pub fn open(dir: &Path) -> Result<Self, DumpError> {
        let mut dump = Self::in_memory(Manifest::read(dir)?)?;
        for (tile, pass) in dump.missing() {
            let path = Manifest::shard_path(dir, tile, pass);
            if path.exists() {
                dump.insert(tile, pass, Arc::new(Shard::open(&path)?))?;
            }
        }
        Ok(dump)
    }

    /// Adds a shard.
    ///
    /// # Errors
    /// If it is of another bake, tile or pass.
    pub fn insert(&mut self, tile: usize, pass: usize, shard: Arc<Shard>) -> Result<(), DumpError> {
        check_place(&self.manifest, &self.bake_id, tile, pass, shard.header())
            .map_err(|reason| DumpError::damaged(shard.path(), reason))?;
        self.shards[tile][pass] = Some(shard);
        Ok(())
    }

    /// Some of the passes alone, as a dump of its own that shares their shards.
    #[must_use]
    pub fn passes(&self, passes: Range<usize>) -> Self {
        let manifest =
            Manifest { passes: self.manifest.passes[passes.clone()].to_vec(), ..(*self.manifest).clone() };
        let shards = self.shards.iter().map(|tile| tile[passes.clone()].to_vec()).collect();
        Self { manifest: Arc::new(manifest), bake_id: Arc::clone(&self.bake_id), shards }
    }

    /// Passes from the first on that are there for every tile.
    pub fn complete_passes(&self) -> usize {
        let of_tile = |tile: &Vec<Option<_>>| tile.iter().take_while(|shard| shard.is_some()).count();
        self.shards.iter().map(of_tile).min().unwrap_or(0)
    }

    /// Manifest of the dump.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// The shards of a tile, in the order of the passes.
    pub fn tile(&self, tile: usize) -> impl Iterator<Item = &Arc<Shard>> + Clone {
        self.shards[tile].iter().flatten()
    }

    /// All shards, tile by tile.
    pub fn shards(&self) -> impl Iterator<Item = &Arc<Shard>> {
        self.shards.iter().flatten().flatten()
    }

    /// Tile and pass of every shard that is not there yet.
    pub fn missing(&self) -> Vec<(usize, usize)> {
        let all = self.shards.iter().enumerate().flat_map(|(tile, passes)| {
            passes.iter().enumerate().map(move |(pass, shard)| (tile, pass, shard))
        });
        all.filter(|(_, _, shard)| shard.is_none()).map(|(tile, pass, _)| (tile, pass)).collect()
    }

    /// Tile and pass of the first shard that is missing although shards of later passes are there: its file was lost, while a bake that
    /// was stopped lacks the last passes.
    pub fn lost(&self) -> Option<(usize, usize)> {
        let pass = self.complete_passes();
        let is_later = |passes: &Vec<Option<Arc<Shard>>>| passes.iter().skip(pass + 1).any(Option::is_some);
        let tile = self.shards.iter().position(|passes| passes.get(pass).is_some_and(Option::is_none))?;
        self.shards.iter().any(is_later).then_some((tile, pass))
    }

    /// True if a tile of a pass is there.
    pub fn has(&self, tile: usize, pass: usize) -> bool {
        self.shards.get(tile).and_then(|passes| passes.get(pass)).is_some_and(Option::is_some)
    }

    /// Samples per pixel of a tile so far.
    pub fn tile_samples(&self, tile: usize) -> u32 {
        self.tile(tile).map(|shard| shard.samples()).sum()
    }

    /// Number of records over all shards.
    pub fn record_count(&self) -> usize {
        self.shards().map(|shard| shard.record_count()).sum()
    }

    /// The tile of an image pixel, and the number of the pixel in it.
    pub fn locate(&self, x: usize, y: usize) -> (usize, usize) {
        let size = self.manifest.tile_size;
        let tile = y / size * self.manifest.tiles_x() + x / size;
        (tile, y % size * self.manifest.tile_rect(tile).width + x % size)
    }

    /// The shards that hold samples of an image pixel, with the number of the pixel in each.
    pub fn pixel(&self, x: usize, y: usize) -> impl Iterator<Item = (&Arc<Shard>, usize)> + Clone {
        let (tile, pixel) = self.locate(x, y);
        self.tile(tile).map(move |shard| (shard, pixel))
    }

    /// Averages the AOVs over all samples; black where there are none.
    pub fn aovs(&self) -> Aovs {
        let mut sums = AovSums::default();
        sums.extend(self);
        sums.means(self)
    }

    /// Reads everything and lists all that is wrong, in words, each with its file; an empty list means sound and
    /// complete.
    pub fn validate(&self) -> Vec<String> {
        let missing = self.missing().into_iter().map(|(tile, pass)| missing(tile, pass));
        missing.chain(self.shards().flat_map(|shard| problems(shard, &self.manifest))).collect()
    }

    /// Validates a folder like [`Dump::validate`], but goes on past shards that cannot be opened.
    pub fn validate_dir(dir: &Path) -> Result<Vec<String>, DumpError> {
        Ok(Self::faults(dir)?.into_iter().map(|fault| fault.words).collect())
    }

    /// Reads everything in a folder and tells of each shard what is wrong with it, pass by pass.
    ///
    /// # Errors
    /// If the manifest cannot be read.
    pub fn faults(dir: &Path) -> Result<Vec<ShardFault>, DumpError> {
        let dump = Self::in_memory(Manifest::read(dir)?)?;
        let (tiles, passes) = (dump.manifest.tile_count(), dump.manifest.passes.len());
        let of_shard = |number: usize| {
            let (tile, pass) = (number % tiles, number / tiles);
            let path = Manifest::shard_path(dir, tile, pass);
            let is_missing = !path.exists();
            let words =
                if is_missing { vec![missing(tile, pass)] } else { dump.faults_of(&path, tile, pass) };
            let fault = move |words| ShardFault { tile, pass, is_missing, words };
            words.into_iter().map(fault).collect::<Vec<_>>()
        };
        Ok((0..tiles * passes).into_par_iter().flat_map_iter(of_shard).collect())
    }

    /// Faults of a shard's file.
    fn faults_of(&self, path: &Path, tile: usize, pass: usize) -> Vec<String> {
        let opened = Shard::open(path).and_then(|shard| {
            let place = check_place(&self.manifest, &self.bake_id, tile, pass, shard.header());
            place.map(|()| shard).map_err(|reason| DumpError::damaged(path, reason))
        });
        match opened {
            Ok(shard) => problems(&shard, &self.manifest),
            Err(error) => vec![error.to_string()],
        }
    }
}

/// Fault of one shard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShardFault {
    /// Tile number.
    pub tile: usize,
    /// Pass number.
    pub pass: usize,
    /// True if there is no file.
    pub is_missing: bool,
    /// Fault, in words; names the file, if there is one.
    pub words: String,
}

fn missing(tile: usize, pass: usize) -> String {
    format!("tile {tile}, pass {pass} is missing")
}

fn problems(shard: &Shard, manifest: &Manifest) -> Vec<String> {
    let found = shard.problems(manifest.receiver_count());
    found.into_iter().map(|problem| format!("{}: {problem}", shard.path().display())).collect()
}

impl AovSums {
    /// Adds the passes of a dump that have not been added yet. Shards that are missing in a pass are left out for good.
    pub fn extend(&mut self, dump: &Dump) {
        let manifest = &dump.manifest;
        self.samples.resize(manifest.tile_count(), 0);
        self.sums.resize(manifest.width * manifest.height, [0.0; AOV_CHANNELS]);
        for (tile, shards) in dump.shards.iter().enumerate() {
            for shard in shards.iter().skip(self.passes).flatten() {
                self.samples[tile] += shard.samples();
                let places = places(manifest.tile_rect(tile), manifest.width);
                for (place, values) in places.zip(shard.aov()) {
                    for (sum, value) in self.sums[place].iter_mut().zip(values) {
                        *sum += value;
                    }
                }
            }
        }
        self.passes = manifest.passes.len();
    }

    /// The averages over all samples that were added, in the image of this dump; black where there are none.
    pub fn means(&self, dump: &Dump) -> Aovs {
        let Manifest { width, height, .. } = *dump.manifest;
        let image = |channels| Image::new(width, height, channels);
        let mut aovs = Aovs {
            albedo: image(3),
            normal: image(3),
            depth: image(1),
            emission: image(3),
            world: image(3),
            alpha: image(1),
        };
        for (tile, &samples) in self.samples.iter().enumerate() {
            let scale = 1.0 / samples.max(1) as f32;
            for place in places(dump.manifest.tile_rect(tile), width) {
                aovs.set(place, &self.sums[place], scale);
            }
        }
        aovs
    }
}

impl Aovs {
    fn set(&mut self, pixel: usize, sums: &[f32; AOV_CHANNELS], scale: f32) {
        let copy = |image: &mut Image, first: usize, scale: f32| {
            for channel in 0..image.channels {
                image.data[pixel * image.channels + channel] = sums[first + channel] * scale;
            }
        };
        copy(&mut self.albedo, aov_channel::ALBEDO, scale);
        copy(&mut self.normal, aov_channel::NORMAL, scale);
        copy(&mut self.depth, aov_channel::DEPTH, 1.0 / sums[aov_channel::HITS].max(1.0));
        copy(&mut self.emission, aov_channel::EMISSION, scale);
        copy(&mut self.world, aov_channel::WORLD, scale);
        copy(&mut self.alpha, aov_channel::ALPHA, scale);
    }
}

/// Places of a tile's pixels in an image of this width, row by row.
fn places(rect: TileRect, width: usize) -> impl Iterator<Item = usize> {
    (0..rect.pixel_count())
        .map(move |pixel| (rect.y + pixel / rect.width) * width + rect.x + pixel % rect.width)
}

/// Checks that a shard is of this bake, tile and pass.
pub(crate) fn check_membership(
    manifest: &Manifest,
    tile: usize,
    pass: usize,
    header: &ShardHeader,
) -> Result<(), String> {
    check_place(manifest, &manifest.bake_id(), tile, pass, header)
}

fn check_place(
    manifest: &Manifest,
    bake_id: &str,
    tile: usize,
    pass: usize,
    header: &ShardHeader,
) -> Result<(), String> {
    if header.bake_id != bake_id {
        return Err("it belongs to another bake".into());
    }
    if tile >= manifest.tile_count() || header.rect != manifest.tile_rect(tile) {
        return Err(format!("it is not tile {tile}"));
    }
    if manifest.passes.get(pass) != Some(&header.pass) {
        return Err(format!("it is not pass {pass}"));
    }
    if header.camera_position != manifest.camera_position {
        return Err("its camera position is not the manifest's".into());
    }
    Ok(())
}
