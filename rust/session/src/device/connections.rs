//! Lights connected to the vertices of light-free paths, where the scene of a bake is at hand.

mod parts;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use glam::Vec3;
use rayon::prelude::*;
use relume_dump::{Manifest, Pass, TileRect};
use relume_gather::{Balance, Emitter, Gather, GatherError, LightSample, PreparedLight};
use relume_image::Image;
use relume_scene::{Light, Scene};
use relume_trace::bvh::SceneBvh;
use relume_trace::sampler::PixelSampler;
use relume_trace::{
    ConnectScratch, PathScratch, PathVertex, TileVertices, TraceSettings, Tracer, VertexLimits,
};
use self_cell::self_cell;

use crate::error::SessionError;
use crate::relight::light_cache::LightCache;

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

struct Level {
    pass: Pass,
    limits: VertexLimits,
    /// Vertices of each tile, where memory allows to keep them. Others are traced anew for each use.
    kept: Vec<OnceLock<TileVertices>>,
}

/// Part of a light's unit image that is summed by connections.
pub(crate) struct ConnectedImage {
    pub levels: usize,
    /// Paths per pixel behind it.
    paths: u32,
    pub image: Image,
    /// Draw of its error; empty for a single level.
    pub error: Image,
}

/// Images of some lights, by their number.
pub(crate) type NumberedImages = Vec<(usize, Arc<ConnectedImage>)>;

/// Group of the sampler whose numbers choose points on lights.
const LIGHT_GROUP: u32 = 1 << 25;
/// Memory of all vertices that are kept, of all shots that are shown together, bytes. The first level of each is kept
/// whatever it takes.
const VERTEX_MEMORY: usize = 1 << 30;
/// Paths per pixel whose vertices lights are connected to.
const PATHS: u32 = 32;
/// Vertices that are kept of a path but its first: those of later bounces matter less.
const LATER: u32 = 2;
/// Least share of a light that is connected at each vertex. Below it, fewer vertices are connected in its place.
const LEAST_SHARE: f32 = 0.1;
/// Memory of images that are kept for later, bytes.
const IMAGE_MEMORY: usize = 1 << 28;

impl Connections {
    /// Makes the scene of a bake ready, whose trees may be there already, in the memory of one of so many shots; none if its
    /// lights have to be summed over crossings alone.
    ///
    /// # Errors
    /// If the scene is not that of the bake, or has too many triangles.
    pub fn new(
        scene: Arc<Scene>,
        manifest: &Manifest,
        bvh: Option<SceneBvh>,
        shots: usize,
    ) -> Result<Option<Self>, SessionError> {
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
        if !tracer.borrow_dependent().connects() {
            return Ok(None);
        }
        let (manifest, levels) = (manifest.clone(), levels(manifest));
        // As many levels as the bake has passes count.
        let connected = levels.iter().take(manifest.passes.len()).map(|level| level.pass.samples).sum();
        let balance = Balance { connected, crossed: manifest.samples() };
        Ok(Some(Self {
            tracer,
            manifest,
            levels,
            prepared: AtomicUsize::new(0),
            most_kept: OnceLock::new(),
            memory: VERTEX_MEMORY / shots.max(1),
            balance,
            images: Mutex::default(),
        }))
    }

    /// True once all levels are prepared that keep their vertices.
    pub fn is_prepared(&self) -> bool {
        self.prepared.load(Ordering::Acquire) == self.most_kept()
    }

    /// Traces the vertices of the next level that keeps them; false if there is none, or `stop` ended it. The next call
    /// goes on at the tiles that it left out.
    pub fn prepare_next(&self, stop: &(dyn Fn() -> bool + Sync)) -> bool {
        let number = self.prepared.load(Ordering::Acquire);
        if number == self.most_kept() {
            return false;
        }
        let level = &self.levels[number];
        let prepare = |scratch: &mut PathScratch, (tile, kept): (usize, &OnceLock<TileVertices>)| {
            if !stop() {
                kept.get_or_init(|| self.trace(level, tile, scratch));
            }
        };
        level.kept.par_iter().enumerate().for_each_init(PathScratch::default, prepare);
        let is_whole = level.kept.iter().all(|tile| tile.get().is_some());
        if is_whole {
            self.prepared.store(number + 1, Ordering::Release);
        }
        is_whole
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
            let bytes: usize = first.kept.iter().filter_map(OnceLock::get).map(TileVertices::bytes).sum();
            levels_within(self.memory, bytes, self.levels.iter().map(|level| level.pass.samples))
        })
    }

    fn trace(&self, level: &Level, tile: usize, scratch: &mut PathScratch) -> TileVertices {
        let rect = self.manifest.tile_rect(tile);
        self.tracer.borrow_dependent().path_vertices(rect, level.pass, level.limits, scratch)
    }

    /// True if the scene is that of a bake.
    pub fn is_of(&self, manifest: &Manifest) -> bool {
        self.manifest.scene_hash == manifest.scene_hash && self.manifest.seed == manifest.seed
    }

    /// Those of some lights that are connected, by their number.
    ///
    /// # Errors
    /// If a light is none: see [`relume_gather::PreparedLight::new`].
    pub fn emitters(&self, lights: &[Light]) -> Result<Vec<(usize, Emitter)>, GatherError> {
        let emitter = |(number, light)| Ok((number, Emitter::new(light, &self.manifest, self.balance)?));
        lights.iter().enumerate().filter(|(_, light)| Emitter::covers(light)).map(emitter).collect()
    }

    /// Lights made ready for `gather`, which is of the same bake, without what is connected of them.
    ///
    /// # Errors
    /// If a light is none: see [`relume_gather::PreparedLight::new`].
    pub fn crossed(&self, gather: &Gather, lights: &[Light]) -> Result<Vec<PreparedLight>, GatherError> {
        let prepare = |light| match Emitter::covers(light) {
            true => gather.prepare_balanced(light, self.balance),
            false => gather.prepare(light),
        };
        lights.iter().map(prepare).collect()
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

    /// Images of the first level alone, in a hurry: in blocks of two by two pixels where [`Self::images`] has made none yet.
    pub fn coarse_images(
        &self,
        gather: &Gather,
        lights: &[Light],
        emitters: &[(usize, Emitter)],
    ) -> NumberedImages {
        let known =
            |(number, _): &(usize, Emitter)| Some((*number, self.cache().get(&lights[*number]).cloned()?));
        let known: NumberedImages = emitters.iter().filter_map(known).collect();
        let is_new = |(number, _): &&(usize, Emitter)| known.iter().all(|(known, _)| known != number);
        let (numbers, new): (Vec<usize>, Vec<&Emitter>) =
            emitters.iter().filter(is_new).map(|(number, emitter)| (*number, emitter)).unzip();
        let coarse = |image| Arc::new(ConnectedImage { levels: 0, paths: 0, image, error: Image::default() });
        let images =
            self.level_images(gather, &self.levels[0], &new, 2, &|| false).into_iter().flatten().map(coarse);
        known.into_iter().chain(numbers.into_iter().zip(images)).collect()
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
        let tracer = self.tracer.borrow_dependent();
        self.summed(gather, level, lights.len(), block, stop, |vertex, u, scratch, pixel| {
            for (layer, emitter) in lights.iter().enumerate() {
                pixel.add(layer, connect(tracer, vertex, emitter, u, scratch));
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
        add: impl Fn(&PathVertex, [f32; 4], &mut ConnectScratch, &mut PixelSums<'_>) + Sync,
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
        add: &impl Fn(&PathVertex, [f32; 4], &mut ConnectScratch, &mut PixelSums<'_>),
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
        for (x, y) in
            (0..rect.height).step_by(block).flat_map(|y| (0..rect.width).step_by(block).map(move |x| (x, y)))
        {
            let sampler = PixelSampler::new(self.manifest.seed, (rect.x + x) as u32, (rect.y + y) as u32);
            let first = (1 + LATER) * level.pass.first_sample;
            let number = y * rect.width + x;
            let mut pixel = PixelSums { values: &mut values, pixels: rect.pixel_count(), number, scale };
            for (vertex, number) in vertices.pixel(number).iter().zip(first..) {
                add(vertex, sampler.draw(number, LIGHT_GROUP), &mut scratch, &mut pixel);
            }
        }
        if block > 1 {
            values.chunks_exact_mut(rect.pixel_count()).for_each(|values| fill_blocks(values, rect, block));
        }
        values
    }
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

/// Number of levels, of so many paths each, whose vertices memory allows to keep if those of the first one take so many
/// bytes; one at least.
fn levels_within(memory: usize, bytes_of_first: usize, paths: impl Iterator<Item = u32> + Clone) -> usize {
    let first = paths.clone().next().unwrap_or(1) as usize;
    let most = memory / bytes_of_first.max(1) * first;
    let mut sum = 0;
    let fits = |paths: &u32| {
        sum += *paths as usize;
        sum <= most
    };
    paths.take_while(fits).count().max(1)
}

/// Gives all pixels of each block the value of its first.
fn fill_blocks(values: &mut [[f32; 3]], rect: TileRect, block: usize) {
    for y in 0..rect.height {
        for x in 0..rect.width {
            values[y * rect.width + x] = values[(y - y % block) * rect.width + x - x % block];
        }
    }
}

/// Light of one point on a light at a vertex, as it adds to the pixel, by numbers in 0..1.
fn connect(
    tracer: &Tracer<'_>,
    vertex: &PathVertex,
    light: &Emitter,
    numbers: [f32; 4],
    scratch: &mut ConnectScratch,
) -> Vec3 {
    let Some((sample, weights)) = weighed_sample(vertex, light, numbers) else { return Vec3::ZERO };
    sample.radiance * tracer.connect(vertex, sample.direction, sample.distance, weights, scratch)
}

/// A point on a light for a vertex by numbers in 0..1, and its weights for each of [`relume_dump::Lobe::CONNECTED`].
fn weighed_sample(
    vertex: &PathVertex,
    light: &Emitter,
    [u, v, chance, ..]: [f32; 4],
) -> Option<(LightSample, [f32; 2])> {
    let (shares, factors) = (light.shares(vertex.position), light.factors(vertex.receiver()));
    let counts = vertex.lobes();
    let weights: [f32; 2] =
        std::array::from_fn(|lobe| if counts[lobe] { shares[lobe] * factors[lobe] } else { 0.0 });
    let most = (0..2).filter(|lobe| weights[*lobe] != 0.0).map(|lobe| shares[lobe]).fold(0.0, f32::max);
    if most <= chance * LEAST_SHARE {
        return None;
    }
    let weights = weights.map(|weight| weight * (LEAST_SHARE / most).max(1.0));
    Some((light.sample(vertex.position, vertex.normal(), [u, v])?, weights))
}

/// Levels of a picture.
fn levels(manifest: &Manifest) -> Vec<Level> {
    let first_sample = manifest.passes.first().map_or(0, |pass| pass.first_sample);
    let mut levels = Vec::new();
    let mut sum = 0;
    while sum < PATHS {
        let samples = sum.clamp(1, PATHS - sum);
        levels.push(Level {
            pass: Pass { first_sample: first_sample + sum, samples },
            limits: VertexLimits { first: samples as usize, later: (LATER * samples) as usize },
            kept: (0..manifest.tile_count()).map(|_| OnceLock::new()).collect(),
        });
        sum += samples;
    }
    levels
}

impl ConnectedImage {
    /// Image of one level more, which is of so many paths.
    fn grown(before: Option<&Self>, mut image: Image, samples: u32) -> Self {
        let Some(before) = before else {
            return Self { levels: 1, paths: samples, image, error: Image::default() };
        };
        let paths = before.paths + samples;
        let share = samples as f32 / paths as f32;
        // As in `Gathered::add`.
        let scale = (share * (1.0 - share)).sqrt();
        let mut error = before.image.clone();
        for ((value, error), before) in image.data.iter_mut().zip(&mut error.data).zip(&before.image.data) {
            let difference = *value - before;
            *value = before + share * difference;
            *error = scale * difference;
        }
        Self { levels: before.levels + 1, paths, image, error }
    }

    fn bytes(&self) -> usize {
        size_of_val(self.image.data.as_slice()) + size_of_val(self.error.data.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_box::{bulbs, closed_box_of, glossy_grey, grey};
    use relume_dump::MemoryWriter;
    use relume_gather::SampleSplit;
    use relume_scene::LightShape;
    use relume_trace::Control;

    #[test]
    fn connected_light_has_the_mean_of_crossings_and_less_noise() {
        for nodes in [vec![grey()], glossy_grey(0.6)] {
            compare_with_crossings(closed_box_of((24, 24), nodes).unwrap());
        }
    }

    #[test]
    fn vertices_of_twelve_large_shots_stay_within_the_memory_of_one_but_for_their_first_level() {
        let paths = [1, 1, 2, 4, 8, 16];
        // Three vertices of 64 bytes for each pixel and path.
        let first = |width: usize, height: usize| 192 * width * height;
        let kept = |bytes, shots| levels_within(VERTEX_MEMORY / shots, bytes, paths.into_iter());
        assert_eq!(kept(first(640, 360), 1), 5, "16 paths are 0.7 GB");
        assert_eq!(kept(first(3840, 2160), 1), 1, "even one is more");
        for (width, height) in [(640, 360), (960, 540), (1920, 1080), (3840, 2160)] {
            let bytes = first(width, height);
            for shots in 1..=12 {
                let of_one = paths[..kept(bytes, shots)].iter().sum::<u32>() as usize * bytes;
                assert!(of_one <= bytes.max(VERTEX_MEMORY / shots), "{shots} shots, {width} x {height}");
            }
        }
    }

    #[test]
    fn preparing_goes_on_where_it_was_stopped() {
        let scene = Arc::new(closed_box_of((24, 24), vec![grey()]).unwrap());
        let settings = TraceSettings { samples: 2, tile_size: 8, ..TraceSettings::default() };
        let manifest = Tracer::new(&scene, &settings).unwrap().manifest();
        let connections = Connections::new(scene, &manifest, None, 1).unwrap().unwrap();
        let traced = || connections.levels[0].kept.iter().filter(|tile| tile.get().is_some()).count();
        let asked = AtomicUsize::new(0);
        assert!(!connections.prepare_next(&|| asked.fetch_add(1, Ordering::Relaxed) >= 4));
        assert_eq!((traced(), connections.ready()), (4, 0));
        let asked = AtomicUsize::new(0);
        assert!(connections.prepare_next(&|| {
            asked.fetch_add(1, Ordering::Relaxed);
            false
        }));
        assert_eq!((traced(), connections.ready()), (9, 1));
        assert!(!connections.is_prepared());
        while connections.prepare_next(&|| false) {}
        assert!(connections.is_prepared());
    }

    fn compare_with_crossings(scene: Scene) {
        let scene = Arc::new(scene);
        let settings = TraceSettings { samples: 1024, ..TraceSettings::default() };
        let tracer = Tracer::new(&scene, &settings).unwrap();
        let writer = MemoryWriter::new(tracer.manifest()).unwrap();
        tracer.trace(&writer, &Control::default()).unwrap();
        let gather = Gather::new(writer.snapshot());
        // As many paths as are connected.
        let few = Gather::new(gather.dump().passes(0..6));
        let connections =
            Connections::new(scene.clone(), gather.dump().manifest(), None, 1).unwrap().unwrap();
        while connections.prepare_next(&|| false) {}
        let mut lights = bulbs(3);
        let panel = |edge: f32| LightShape::Quad {
            center: Vec3::new(0.2, 0.1, 0.9),
            edge_u: Vec3::Y * edge,
            edge_v: Vec3::X * edge,
            spread: std::f32::consts::PI,
        };
        let large = [panel(0.1), panel(1.2), LightShape::Sphere { center: Vec3::splat(0.7), radius: 0.6 }];
        lights.extend(large.map(Light::unit));
        let emitters = connections.emitters(&lights).unwrap();
        let joined = connections.images(&gather, &lights, &emitters, usize::MAX, &|| false).unwrap();
        let rest = gather.unit_images(&connections.crossed(&gather, &lights).unwrap(), SampleSplit::All);
        for ((light, mut image), (_, joined)) in lights.iter().zip(rest).zip(joined) {
            image.add_scaled(&joined.image, &[1.0; 3]);
            let crossed = &gather.unit_images(&[gather.prepare(light).unwrap()], SampleSplit::All)[0];
            let differences: Vec<f64> =
                crossed.data.iter().zip(&image.data).map(|(a, b)| f64::from(a - b)).collect();
            let count = differences.len() as f64;
            let mean = differences.iter().sum::<f64>() / count;
            let variance = differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / count;
            // Channels of a grey box are all alike.
            let standard_error = (3.0 * variance / count).sqrt();
            assert!(mean.abs() < 4.0 * standard_error, "{mean} +- {standard_error}");
            let noise = |image: &Image| {
                let rough = image.data.chunks_exact(3).zip(image.data[3..].chunks_exact(3));
                rough.map(|(a, b)| f64::from(a[0] - b[0]).powi(2)).sum::<f64>()
            };
            let few = &few.unit_images(&[few.prepare(light).unwrap()], SampleSplit::All)[0];
            assert!(noise(&image) < 0.3 * noise(few), "{} {}", noise(&image), noise(few));
        }
    }
}
