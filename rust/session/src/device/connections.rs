//! Lights connected to the vertices of light-free paths, where the scene of a bake is at hand.

mod connection;
mod image;
mod levels;
mod parts;

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use glam::Vec3;
use rayon::prelude::*;
use relume_dump::{Manifest, Pass, TileRect};
use relume_gather::{Balance, Emitter, Gather, GatherError, PreparedLight};
use relume_image::Image;
use relume_scene::{Light, Scene};
use relume_trace::bvh::SceneBvh;
use relume_trace::{
    ConnectScratch, PathScratch, PathVertex, PixelVertices, TraceSettings, Tracer, UnpackedVertex,
};
use self_cell::self_cell;

use self::levels::{KEPT, Level, VERTEX_MEMORY, levels, levels_within};
use crate::error::SessionError;
use crate::files::damage::{damage_message, reason_of};
use crate::files::names::SCENE_FILE;
use crate::files::scene_file::SceneFile;
use crate::relight::light_cache::LightCache;

pub(crate) use self::connection::connect;
pub(crate) use self::image::ConnectedImage;
pub(crate) use self::levels::limits;

self_cell!(
    struct OwnedTracer {
        owner: Arc<Scene>,
        #[covariant]
        dependent: Tracer,
    }
);

/// Vertices of paths of a bake's scene, and the light of lights that were connected to them. Vertices come in levels, each
/// with as many paths as all before it, so that a first picture comes early.
pub(crate) struct Connections {
    tracer: OwnedTracer,
    manifest: Manifest,
    levels: Vec<Level>,
    /// Number of levels whose vertices were traced to be kept.
    prepared: AtomicUsize,
    /// Number of levels whose vertices memory allows to keep, known from the first one on.
    most_kept: OnceLock<usize>,
    /// Bytes for these.
    memory: usize,
    balance: Balance,
    images: Mutex<LightCache<Arc<ConnectedImage>>>,
}

/// Images of some lights, by their number.
pub(crate) type NumberedImages = Vec<(usize, Arc<ConnectedImage>)>;

/// Group of the sampler whose numbers choose points on lights.
const LIGHT_GROUP: u32 = 1 << 25;
/// Memory of images that are kept for later, bytes.
const IMAGE_MEMORY: usize = 1 << 28;

impl Connections {
    /// Makes the scene of a bake ready, whose trees may be there already, in the memory of one of so many shots.
    ///
    /// # Errors
    /// If the scene is not that of the bake, or has too many triangles.
    pub fn new(
        scene: Arc<Scene>,
        manifest: &Manifest,
        bvh: Option<SceneBvh>,
        shots: usize,
    ) -> Result<Self, SessionError> {
        let fail = |reason: &str| {
            let text = format!(
                "the scene is not the one that was baked: {reason}; lights have more noise without it"
            );
            Err(SessionError::Settings(text))
        };
        if scene.hash() != manifest.scene_hash {
            return fail("it was changed");
        }
        let Ok(paths) = serde_json::from_value(manifest.settings.clone()) else {
            return fail("its settings are of another version of Relume");
        };
        let settings = TraceSettings { paths, seed: manifest.seed, ..TraceSettings::default() };
        let tracer = OwnedTracer::try_new(scene, |scene| match bvh {
            Some(bvh) => Ok(Tracer::with_bvh(scene, &settings, bvh)),
            None => Tracer::new(scene, &settings),
        })?;
        let (manifest, levels) = (manifest.clone(), levels(manifest));
        // As many levels as the bake has passes count.
        let connected = levels.iter().take(manifest.passes.len()).map(|level| level.pass.samples).sum();
        let balance = Balance { connected, crossed: manifest.samples() };
        Ok(Self {
            tracer,
            manifest,
            levels,
            prepared: AtomicUsize::new(0),
            most_kept: OnceLock::new(),
            memory: VERTEX_MEMORY / shots.max(1),
            balance,
            images: Mutex::default(),
        })
    }

    /// Connections in the scene that a bake folder holds; none if it holds none.
    ///
    /// # Errors
    /// Warning for the user if the scene cannot be read or is not that of the bake: see [`Self::new`].
    pub fn stored(folder: &Path, manifest: &Manifest, shots: usize) -> Result<Option<Self>, String> {
        let path = folder.join(SCENE_FILE);
        if !path.exists() {
            return Ok(None);
        }
        let scene = SceneFile::read(&path).map(|file| Arc::new(file.scene));
        let connections = scene.and_then(|scene| Self::new(scene, manifest, None, shots));
        connections.map(Some).map_err(|error| damage_message(&path, &reason_of(error)))
    }

    /// True once all levels are prepared that keep their vertices.
    pub fn is_prepared(&self) -> bool {
        self.prepared.load(Ordering::Acquire) == self.most_kept()
    }

    /// Traces the vertices of so many levels as far as they are kept, where that was not done yet.
    pub fn prepare(&self, levels: usize) {
        self.keep(levels, &|| false);
    }

    /// Traces the vertices of the next level that keeps them; false if there is none, or `stop` ended it. The next call
    /// goes on at the tiles that it left out.
    pub fn prepare_next(&self, stop: &(dyn Fn() -> bool + Sync)) -> bool {
        let number = self.prepared.load(Ordering::Acquire);
        if number == self.most_kept() {
            return false;
        }
        let level = &self.levels[number];
        let prepare = |scratch: &mut PathScratch, (tile, kept): (usize, &OnceLock<PixelVertices>)| {
            if !stop() {
                kept.get_or_init(|| self.trace(level, tile, scratch));
            }
        };
        level.kept.par_iter().enumerate().for_each_init(PathScratch::default, prepare);
        let is_whole = level.kept.iter().all(|tile| tile.get().is_some());
        if is_whole {
            self.prepared.fetch_max(number + 1, Ordering::Release);
        }
        is_whole
    }

    /// Traces the vertices of so many levels, or of as many as are kept, and says how many; nothing if `stop` ended it.
    pub fn keep(&self, levels: usize, stop: &(dyn Fn() -> bool + Sync)) -> Option<usize> {
        while self.prepared.load(Ordering::Acquire) < levels && self.prepare_next(stop) {}
        (!stop()).then(|| levels.min(self.prepared.load(Ordering::Acquire)))
    }

    /// Vertices of a tile by one of the first levels, which are kept, and the number of its paths; that of a random path, by a
    /// number in 0..1.
    pub fn kept(&self, levels: usize, tile: usize, u: f32) -> (&PixelVertices, u32) {
        let levels = &self.levels[..levels];
        let mut left = u * levels.iter().map(|level| level.pass.samples as f32).sum::<f32>();
        let holds_path = |level: &&Level| {
            left -= level.pass.samples as f32;
            left < 0.0
        };
        let level = levels.iter().find(holds_path).unwrap_or(&levels[0]);
        (level.kept[tile].get().expect("levels that were prepared"), level.pass.samples)
    }

    /// Number of levels that lights can be connected to now.
    pub fn ready(&self) -> usize {
        let prepared = self.prepared.load(Ordering::Acquire);
        if prepared < self.most_kept() { prepared } else { self.levels.len() }
    }

    /// Number of levels whose vertices are kept: the first, and others as far as memory allows for paths like its own.
    fn most_kept(&self) -> usize {
        if self.prepared.load(Ordering::Acquire) == 0 {
            return 1;
        }
        *self.most_kept.get_or_init(|| {
            let first = &self.levels[0];
            let bytes: usize = first.kept.iter().filter_map(OnceLock::get).map(PixelVertices::bytes).sum();
            levels_within(self.memory, bytes, self.levels.iter().map(|level| level.pass.samples))
        })
    }

    fn trace(&self, level: &Level, tile: usize, scratch: &mut PathScratch) -> PixelVertices {
        let pixels = self.manifest.tile_rect(tile).pixels();
        self.tracer().path_vertices(pixels, level.pass, level.limits, scratch)
    }

    /// The tracer of the bake's paths.
    pub fn tracer(&self) -> &Tracer<'_> {
        self.tracer.borrow_dependent()
    }

    /// The bake.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// True if the scene is that of a bake.
    pub fn is_of(&self, manifest: &Manifest) -> bool {
        self.manifest.scene_hash == manifest.scene_hash && self.manifest.seed == manifest.seed
    }

    /// [`emitters`] of some lights.
    ///
    /// # Errors
    /// If a light is none: see [`relume_gather::PreparedLight::new`].
    pub fn emitters(&self, lights: &[Light]) -> Result<Vec<(usize, Emitter)>, GatherError> {
        emitters(lights, &self.manifest, self.balance)
    }

    /// [`crossed`] of some lights; `gather` is of the same bake.
    ///
    /// # Errors
    /// If a light is none: see [`relume_gather::PreparedLight::new`].
    pub fn crossed(&self, gather: &Gather, lights: &[Light]) -> Result<Vec<PreparedLight>, GatherError> {
        crossed(gather, lights, self.balance)
    }

    /// Connected parts of the unit images of those of `lights` that are connected, by their number, from so many levels or more as far as
    /// they are there; nothing if `stop` ended it. `gather` is of the same bake.
    pub fn images(
        &self,
        gather: &Gather,
        lights: &[Light],
        emitters: &[(usize, Emitter)],
        levels: usize,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<NumberedImages> {
        let known = |(number, _): &(usize, Emitter)| self.cache().get_used(&lights[*number]).cloned();
        let mut images: Vec<Option<Arc<ConnectedImage>>> = emitters.iter().map(known).collect();
        for (number, level) in self.levels[..self.ready()].iter().enumerate().take(levels) {
            let is_behind = |i: &usize| images[*i].as_ref().map_or(0, |image| image.levels) == number;
            let behind: Vec<usize> = (0..images.len()).filter(is_behind).collect();
            let lights: Vec<&Emitter> = behind.iter().map(|i| &emitters[*i].1).collect();
            for (i, image) in behind.into_iter().zip(self.level_images(gather, level, &lights, 1, stop)?) {
                images[i] =
                    Some(Arc::new(ConnectedImage::grown(images[i].as_deref(), image, level.pass.samples)));
            }
        }
        let mut cache = self.cache();
        let images = emitters.iter().zip(images).filter_map(|((number, _), image)| {
            let image = image?;
            *cache.get_or_insert(&lights[*number], || Arc::clone(&image)) = Arc::clone(&image);
            Some((*number, image))
        });
        let images = Some(images.collect());
        cache.trim(&[], IMAGE_MEMORY, |image| image.bytes());
        images
    }

    /// Images of the first level alone, in a hurry: in blocks of so many pixels each way where [`Self::images`] has made none yet;
    /// nothing if `stop` ended it.
    pub fn coarse_images(
        &self,
        gather: &Gather,
        lights: &[Light],
        emitters: &[(usize, Emitter)],
        block: usize,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<NumberedImages> {
        let known =
            |(number, _): &(usize, Emitter)| Some((*number, self.cache().get(&lights[*number]).cloned()?));
        let known: NumberedImages = emitters.iter().filter_map(known).collect();
        let is_new = |(number, _): &&(usize, Emitter)| known.iter().all(|(known, _)| known != number);
        let (numbers, new): (Vec<usize>, Vec<&Emitter>) =
            emitters.iter().filter(is_new).map(|(number, emitter)| (*number, emitter)).unzip();
        let coarse =
            |image| Arc::new(ConnectedImage { levels: 0, block, paths: 0, image, error: Image::default() });
        let images = self.level_images(gather, &self.levels[0], &new, block, stop)?.into_iter().map(coarse);
        Some(known.into_iter().chain(numbers.into_iter().zip(images)).collect())
    }

    fn cache(&self) -> MutexGuard<'_, LightCache<Arc<ConnectedImage>>> {
        self.images.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Images by the paths of one level, in blocks of so many pixels each way; nothing if `stop` ended it.
    fn level_images(
        &self,
        gather: &Gather,
        level: &Level,
        lights: &[&Emitter],
        block: usize,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Vec<Image>> {
        if lights.is_empty() {
            return Some(Vec::new());
        }
        let tracer = self.tracer();
        self.summed(gather, level, lights.len(), block, stop, |vertex, numbers, scratch, pixel| {
            for (layer, emitter) in lights.iter().enumerate() {
                pixel.add(layer, connect(tracer, vertex, emitter, numbers, scratch));
            }
        })
    }

    /// Images of some layers that each vertex of a level adds to, with numbers in 0..1, in blocks of so many pixels each way; nothing
    /// if `stop` ended it.
    fn summed(
        &self,
        gather: &Gather,
        level: &Level,
        layers: usize,
        block: usize,
        stop: &(dyn Fn() -> bool + Sync),
        add: impl Fn(&UnpackedVertex<'_>, [f32; 4], &mut ConnectScratch, &mut PixelSums<'_>) + Sync,
    ) -> Option<Vec<Image>> {
        let tile = |tile| (!stop()).then(|| self.tile(level, tile, layers, block, &add));
        let tiles: Vec<Vec<[f32; 3]>> =
            (0..self.manifest.tile_count()).into_par_iter().map(tile).collect::<Option<_>>()?;
        Some((0..layers).map(|layer| gather.assemble(&tiles, layer)).collect())
    }

    /// Values of a tile, layer by layer, then pixel by pixel; one pixel of each block is made for all of it.
    fn tile(
        &self,
        level: &Level,
        tile: usize,
        layers: usize,
        block: usize,
        add: &impl Fn(&UnpackedVertex<'_>, [f32; 4], &mut ConnectScratch, &mut PixelSums<'_>),
    ) -> Vec<[f32; 3]> {
        let rect = self.manifest.tile_rect(tile);
        let traced;
        let vertices = match level.kept[tile].get() {
            Some(kept) => kept,
            None => {
                traced = self.trace(level, tile, &mut PathScratch::default());
                &traced
            }
        };
        let mut scratch = ConnectScratch::default();
        let mut values = vec![[0.0; 3]; layers * rect.pixel_count()];
        let scale = 1.0 / level.pass.samples as f32;
        for (left, top) in corners(rect, block) {
            let (x, y) = chosen_pixel(rect, block, (left, top));
            let number = y * rect.width + x;
            let mut pixel = PixelSums { values: &mut values, pixels: rect.pixel_count(), number, scale };
            let vertices = vertices.pixel(number);
            for (vertex, numbers) in self.with_numbers(vertices, (rect.x + x, rect.y + y), level.pass) {
                add(&vertex, numbers, &mut scratch, &mut pixel);
            }
            if block > 1 {
                let layers = values.chunks_exact_mut(rect.pixel_count());
                layers.for_each(|values| fill_block(values, rect, block, (left, top), values[number]));
            }
        }
        values
    }

    /// Gives `add` the light that some lights add to a pixel by all its vertices of a pass, by their number.
    pub fn connect(
        &self,
        (vertices, pixel, pass): (&[PathVertex], (usize, usize), Pass),
        lights: &[&Emitter],
        scratch: &mut ConnectScratch,
        mut add: impl FnMut(usize, [f32; 3]),
    ) {
        for (vertex, numbers) in self.with_numbers(vertices, pixel, pass) {
            for (i, light) in lights.iter().enumerate() {
                add(i, connect(self.tracer(), &vertex, light, numbers, scratch).to_array());
            }
        }
    }

    /// A pixel's vertices of a pass, with the numbers in 0..1 that choose points on lights.
    fn with_numbers<'a>(
        &self,
        vertices: &'a [PathVertex],
        pixel: (usize, usize),
        pass: Pass,
    ) -> impl Iterator<Item = (UnpackedVertex<'a>, [f32; 4])> + use<'a> {
        let sampler = self.tracer().sampler(pixel);
        let numbered = vertices.iter().zip(KEPT * pass.first_sample..);
        numbered.map(move |(vertex, number)| (UnpackedVertex::new(vertex), sampler.draw(number, LIGHT_GROUP)))
    }
}

/// Those of some lights that are connected, by their number.
///
/// # Errors
/// If a light is none: see [`relume_gather::PreparedLight::new`].
pub(crate) fn emitters(
    lights: &[Light],
    manifest: &Manifest,
    balance: Balance,
) -> Result<Vec<(usize, Emitter)>, GatherError> {
    let emitter = |(number, light)| Ok((number, Emitter::new(light, manifest, balance)?));
    let covered = lights.iter().enumerate().filter(|(_, light)| Emitter::covers(light, manifest));
    covered.map(emitter).collect()
}

/// Lights made ready for a gather without what is connected of them.
///
/// # Errors
/// If a light is none: see [`relume_gather::PreparedLight::new`].
pub(crate) fn crossed(
    gather: &Gather,
    lights: &[Light],
    balance: Balance,
) -> Result<Vec<PreparedLight>, GatherError> {
    let prepare = |light| match Emitter::covers(light, gather.dump().manifest()) {
        true => gather.prepare_balanced(light, balance),
        false => gather.prepare(light),
    };
    lights.iter().map(prepare).collect()
}

/// Sums of one pixel in several layers.
struct PixelSums<'a> {
    /// Layer by layer, then pixel by pixel.
    values: &'a mut [[f32; 3]],
    /// Pixels of a layer.
    pixels: usize,
    number: usize,
    scale: f32,
}

impl PixelSums<'_> {
    fn add(&mut self, layer: usize, light: Vec3) {
        let value = &mut self.values[layer * self.pixels + self.number];
        value.iter_mut().zip((self.scale * light).to_array()).for_each(|(value, light)| *value += light);
    }
}

/// First pixels of the blocks of a tile.
fn corners(rect: TileRect, block: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..rect.height).step_by(block).flat_map(move |y| (0..rect.width).step_by(block).map(move |x| (x, y)))
}

/// Pixel of a block that stands for it: another corner in each of two by two blocks, so that their mean place is the middle.
fn chosen_pixel(rect: TileRect, block: usize, (left, top): (usize, usize)) -> (usize, usize) {
    let (right, low) = ((left / block) % 2 == 1, (top / block) % 2 == 1);
    let x = if right != low { left + block - 1 } else { left };
    let y = if low { top + block - 1 } else { top };
    (x.min(rect.width - 1), y.min(rect.height - 1))
}

/// Gives all pixels of a block a value.
fn fill_block(
    values: &mut [[f32; 3]],
    rect: TileRect,
    block: usize,
    (left, top): (usize, usize),
    value: [f32; 3],
) {
    let columns = left..rect.width.min(left + block);
    for y in top..rect.height.min(top + block) {
        values[y * rect.width..][columns.clone()].fill(value);
    }
}

#[cfg(test)]
mod tests;
