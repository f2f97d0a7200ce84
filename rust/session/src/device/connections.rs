//! Lights connected to the vertices of light-free paths, where the scene of a bake is at hand.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use glam::Vec3;
use rayon::prelude::*;
use relume_dump::{Manifest, Pass, TileRect};
use relume_gather::{Balance, Emitter, Gather, GatherError, PreparedLight};
use relume_image::Image;
use relume_scene::{Light, Scene};
use relume_trace::bvh::SceneBvh;
use relume_trace::sampler::PixelSampler;
use relume_trace::{
    ConnectScratch, PathScratch, PathVertex, PixelVertices, TraceSettings, Tracer, VertexLimits,
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
    balance: Balance,
    images: Mutex<LightCache<Arc<ConnectedImage>>>,
}

struct Level {
    pass: Pass,
    limits: VertexLimits,
    /// Vertices of each tile, where memory allows to keep them. Others are traced anew for each use.
    kept: Vec<OnceLock<PixelVertices>>,
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
/// Memory of all vertices that are kept, bytes.
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
    /// Makes the scene of a bake ready, whose trees may be there already; none if its lights have to be summed over crossings
    /// alone.
    ///
    /// # Errors
    /// If the scene is not that of the bake, or has too many triangles.
    pub fn new(
        scene: Arc<Scene>,
        manifest: &Manifest,
        bvh: Option<SceneBvh>,
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
            balance,
            images: Mutex::default(),
        }))
    }

    /// Traces the vertices of so many levels as far as they are kept, where that was not done yet.
    pub fn prepare(&self, levels: usize) {
        while self.prepared.load(Ordering::Acquire) < levels && self.prepare_next(&|| false) {}
    }

    /// Traces the vertices of the next level that keeps them; false if there is none, or `stop` ended it.
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
            let bytes: usize = first.kept.iter().filter_map(OnceLock::get).map(PixelVertices::bytes).sum();
            let paths = VERTEX_MEMORY / bytes.max(1) * first.pass.samples as usize;
            let mut sum = 0;
            let fits = |level: &&Level| {
                sum += level.pass.samples as usize;
                sum <= paths
            };
            self.levels.iter().take_while(fits).count().max(1)
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
        let tile = |tile| (!stop()).then(|| self.tile(level, tile, lights, block));
        let tiles: Vec<Vec<[f32; 3]>> =
            (0..self.manifest.tile_count()).into_par_iter().map(tile).collect::<Option<_>>()?;
        Some((0..lights.len()).map(|light| gather.assemble(&tiles, light)).collect())
    }

    /// Values of a tile, light by light, then pixel by pixel; one pixel of each block is made for all of it.
    fn tile(&self, level: &Level, tile: usize, lights: &[&Emitter], block: usize) -> Vec<[f32; 3]> {
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
        let mut values = vec![[0.0; 3]; lights.len() * rect.pixel_count()];
        let scale = 1.0 / level.pass.samples as f32;
        for (x, y) in
            (0..rect.height).step_by(block).flat_map(|y| (0..rect.width).step_by(block).map(move |x| (x, y)))
        {
            let pixel = y * rect.width + x;
            let vertices = (vertices.pixel(pixel), (rect.x + x, rect.y + y), level.pass);
            self.connect(vertices, lights, &mut scratch, |number, light| {
                let value = &mut values[number * rect.pixel_count() + pixel];
                value.iter_mut().zip(light).for_each(|(value, light)| *value += scale * light);
            });
        }
        if block > 1 {
            values.chunks_exact_mut(rect.pixel_count()).for_each(|values| fill_blocks(values, rect, block));
        }
        values
    }

    /// Gives `add` the light that some lights add to a pixel by all its vertices of a pass, by their number.
    pub fn connect(
        &self,
        (vertices, (x, y), pass): (&[PathVertex], (usize, usize), Pass),
        lights: &[&Emitter],
        scratch: &mut ConnectScratch,
        mut add: impl FnMut(usize, [f32; 3]),
    ) {
        let sampler = PixelSampler::new(self.manifest.seed, x as u32, y as u32);
        for (vertex, number) in vertices.iter().zip((1 + LATER) * pass.first_sample..) {
            let u = sampler.draw(number, LIGHT_GROUP);
            for (i, light) in lights.iter().enumerate() {
                add(i, connect(self.tracer(), vertex, light, u, scratch).to_array());
            }
        }
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
    lights.iter().enumerate().filter(|(_, light)| Emitter::covers(light)).map(emitter).collect()
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
    let prepare = |light| match Emitter::covers(light) {
        true => gather.prepare_balanced(light, balance),
        false => gather.prepare(light),
    };
    lights.iter().map(prepare).collect()
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
    [u, v, chance, ..]: [f32; 4],
    scratch: &mut ConnectScratch,
) -> Vec3 {
    let (shares, factors) = (light.shares(vertex.position), light.factors(vertex.receiver()));
    let counts = vertex.lobes();
    let weights: [f32; 2] =
        std::array::from_fn(|lobe| if counts[lobe] { shares[lobe] * factors[lobe] } else { 0.0 });
    let most = (0..2).filter(|lobe| weights[*lobe] != 0.0).map(|lobe| shares[lobe]).fold(0.0, f32::max);
    if most <= chance * LEAST_SHARE {
        return Vec3::ZERO;
    }
    let weights = weights.map(|weight| weight * (LEAST_SHARE / most).max(1.0));
    let Some(sample) = light.sample(vertex.position, vertex.normal(), [u, v]) else { return Vec3::ZERO };
    sample.radiance * tracer.connect(vertex, sample.direction, sample.distance, weights, scratch)
}

/// Most vertices that are kept of a pixel of so many paths.
pub(crate) fn limits(samples: u32) -> VertexLimits {
    VertexLimits { first: samples as usize, later: (LATER * samples) as usize }
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
            limits: limits(samples),
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

    fn compare_with_crossings(scene: Scene) {
        let scene = Arc::new(scene);
        let settings = TraceSettings { samples: 1024, ..TraceSettings::default() };
        let tracer = Tracer::new(&scene, &settings).unwrap();
        let writer = MemoryWriter::new(tracer.manifest()).unwrap();
        tracer.trace(&writer, &Control::default()).unwrap();
        let gather = Gather::new(writer.snapshot());
        // As many paths as are connected.
        let few = Gather::new(gather.dump().passes(0..6));
        let connections = Connections::new(scene.clone(), gather.dump().manifest(), None).unwrap().unwrap();
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
