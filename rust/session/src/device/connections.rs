//! Lights connected to the vertices of light-free paths, where the scene of a bake is at hand.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use rayon::prelude::*;
use relume_dump::{Manifest, Pass};
use relume_gather::{Emitter, Gather, GatherError};
use relume_image::Image;
use relume_scene::{Light, Scene};
use relume_trace::sampler::PixelSampler;
use relume_trace::{
    ConnectScratch, DiffuseVertex, PathScratch, TileVertices, TraceSettings, Tracer, VertexLimits,
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

/// Diffuse vertices of paths of a bake's scene, and the light of lights that were connected to them. Vertices are traced tile by tile
/// where they are first asked for. They come in levels, each with as many paths as all before it, so that a first picture
/// comes early.
pub(crate) struct Connections {
    tracer: OwnedTracer,
    manifest: Manifest,
    levels: Vec<Level>,
    images: Mutex<LightCache<Connected>>,
}

struct Level {
    pass: Pass,
    limits: VertexLimits,
    tiles: Vec<OnceLock<TileVertices>>,
}

/// Diffuse light of one light.
#[derive(Clone, Default)]
struct Connected {
    levels: usize,
    /// Paths per pixel behind the image.
    paths: u32,
    image: Image,
}

/// Lights, each divided into what is connected and what is summed over crossings.
pub(crate) struct SplitLights {
    /// Lights that are connected, by their number.
    pub emitters: Vec<(usize, Emitter)>,
    /// What remains of all lights.
    pub rest: Vec<Light>,
}

/// Group of the sampler whose numbers choose points on lights.
const LIGHT_GROUP: u32 = 1 << 25;
/// Memory of all vertices, bytes.
const VERTEX_MEMORY: usize = 1 << 30;
/// Least and most paths per pixel whose vertices are kept.
const PATHS: std::ops::RangeInclusive<u32> = 2..=64;
/// Vertices that are kept of a path but its first: those of later bounces matter less.
const LATER: u32 = 2;
/// Memory of images that are kept for later, bytes.
const IMAGE_MEMORY: usize = 1 << 28;

impl Connections {
    /// Makes the scene of a bake ready; none if its lights have to be summed over crossings alone.
    ///
    /// # Errors
    /// If the scene is not that of the bake, or has too many triangles.
    pub fn new(scene: Arc<Scene>, manifest: &Manifest) -> Result<Option<Self>, SessionError> {
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
        let tracer = OwnedTracer::try_new(scene, |scene| Tracer::new(scene, &settings))?;
        if !tracer.borrow_dependent().connects() {
            return Ok(None);
        }
        let (manifest, levels) = (manifest.clone(), levels(manifest));
        Ok(Some(Self { tracer, manifest, levels, images: Mutex::default() }))
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Divides lights into what is connected and what is not.
    ///
    /// # Errors
    /// If a light is none: see [`relume_gather::PreparedLight::new`].
    pub fn split(&self, lights: &[Light]) -> Result<SplitLights, GatherError> {
        let mut split = SplitLights { emitters: Vec::new(), rest: lights.to_vec() };
        let diffuse = |(_, light): &(usize, &mut Light)| light.lobes.diffuse != 0.0;
        for (number, rest) in split.rest.iter_mut().enumerate().filter(diffuse) {
            if let Some(emitter) = Emitter::new(rest, &self.manifest)? {
                rest.lobes.diffuse = 0.0;
                split.emitters.push((number, emitter));
            }
        }
        Ok(split)
    }

    /// Diffuse part of the unit images of those of `lights` that are connected, by their number, from so many levels or more.
    /// `gather` is of the same bake.
    pub fn unit_images(
        &self,
        gather: &Gather,
        lights: &[Light],
        emitters: &[(usize, Emitter)],
        levels: usize,
    ) -> Vec<(usize, Image)> {
        let known = |number: usize| {
            let mut images = self.images.lock().unwrap_or_else(PoisonError::into_inner);
            let connected = images.get_used(&lights[number]);
            connected.map_or_else(Connected::default, |known| known.clone())
        };
        let mut images: Vec<Connected> = emitters.iter().map(|(number, _)| known(*number)).collect();
        for level in 0..levels.min(self.levels.len()) {
            let behind: Vec<usize> = (0..images.len()).filter(|i| images[*i].levels == level).collect();
            let lights: Vec<&Emitter> = behind.iter().map(|i| &emitters[*i].1).collect();
            let added = self.level_images(gather, level, &lights);
            behind.iter().zip(added).for_each(|(i, image)| images[*i].add(image, &self.levels[level].pass));
        }
        let mut cache = self.images.lock().unwrap_or_else(PoisonError::into_inner);
        for ((number, _), connected) in emitters.iter().zip(&images) {
            let kept = cache.get_or_insert(&lights[*number], Connected::default);
            if kept.levels < connected.levels {
                *kept = connected.clone();
            }
        }
        cache.trim(&[], IMAGE_MEMORY, |connected| size_of_val(connected.image.data.as_slice()));
        emitters.iter().map(|(number, _)| *number).zip(images.into_iter().map(|known| known.image)).collect()
    }

    /// Images by the paths of one level.
    fn level_images(&self, gather: &Gather, level: usize, lights: &[&Emitter]) -> Vec<Image> {
        if lights.is_empty() {
            return Vec::new();
        }
        let level = &self.levels[level];
        let tiles: Vec<Vec<[f32; 3]>> =
            (0..level.tiles.len()).into_par_iter().map(|tile| self.tile(level, tile, lights)).collect();
        (0..lights.len()).map(|light| gather.assemble(&tiles, light)).collect()
    }

    /// Values of a tile, light by light, then pixel by pixel.
    fn tile(&self, level: &Level, tile: usize, lights: &[&Emitter]) -> Vec<[f32; 3]> {
        let (tracer, rect) = (self.tracer.borrow_dependent(), self.manifest.tile_rect(tile));
        let trace = || tracer.diffuse_vertices(rect, level.pass, level.limits, &mut PathScratch::default());
        let vertices = level.tiles[tile].get_or_init(trace);
        let mut scratch = ConnectScratch::default();
        let mut sums = vec![[0.0; 3]; lights.len() * rect.pixel_count()];
        let scale = 1.0 / level.pass.samples as f32;
        for pixel in 0..rect.pixel_count() {
            let (x, y) = (rect.x + pixel % rect.width, rect.y + pixel / rect.width);
            let sampler = PixelSampler::new(self.manifest.seed, x as u32, y as u32);
            let first = LATER * level.pass.first_sample;
            for (vertex, number) in vertices.pixel(pixel).iter().zip(first..) {
                let [u, v, ..] = sampler.draw(number, LIGHT_GROUP);
                for (emitter, sums) in lights.iter().zip(sums.chunks_exact_mut(rect.pixel_count())) {
                    let light = scale * connect(tracer, vertex, emitter, [u, v], &mut scratch);
                    sums[pixel].iter_mut().zip(light.to_array()).for_each(|(sum, light)| *sum += light);
                }
            }
        }
        sums
    }
}

/// What a light adds by one point on it to the pixel of a vertex.
fn connect(
    tracer: &Tracer<'_>,
    vertex: &DiffuseVertex,
    light: &Emitter,
    u: [f32; 2],
    scratch: &mut ConnectScratch,
) -> glam::Vec3 {
    let factor = light.factor(vertex.receiver());
    let sample = (factor != 0.0).then(|| light.sample(vertex.position, vertex.normal(), u)).flatten();
    sample.map_or(glam::Vec3::ZERO, |sample| {
        factor * sample.radiance * tracer.connect(vertex, sample.direction, sample.distance, scratch)
    })
}

/// Levels that fit into memory.
fn levels(manifest: &Manifest) -> Vec<Level> {
    let vertices_a_path = manifest.width * manifest.height * (1 + LATER as usize);
    let fitting = VERTEX_MEMORY / (vertices_a_path * size_of::<DiffuseVertex>()).max(1);
    let paths = (fitting as u32).clamp(*PATHS.start(), *PATHS.end());
    let first_sample = manifest.passes.first().map_or(0, |pass| pass.first_sample);
    let mut levels = Vec::new();
    let mut sum = 0;
    while sum < paths {
        let samples = sum.clamp(1, paths - sum);
        levels.push(Level {
            pass: Pass { first_sample: first_sample + sum, samples },
            limits: VertexLimits { first: samples as usize, later: (LATER * samples) as usize },
            tiles: (0..manifest.tile_count()).map(|_| OnceLock::new()).collect(),
        });
        sum += samples;
    }
    levels
}

impl Connected {
    /// Adds the image of the next level, which is of some paths beside those before.
    fn add(&mut self, image: Image, pass: &Pass) {
        if self.levels == 0 {
            self.image = image;
        } else {
            let share = pass.samples as f32 / (self.paths + pass.samples) as f32;
            let values = self.image.data.iter_mut().zip(&image.data);
            values.for_each(|(value, new)| *value += share * (new - *value));
        }
        self.levels += 1;
        self.paths += pass.samples;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_box::{bulbs, closed_box};
    use relume_dump::MemoryWriter;
    use relume_gather::SampleSplit;
    use relume_trace::Control;

    #[test]
    fn connected_light_has_the_mean_of_crossings_and_less_noise() {
        let scene = Arc::new(closed_box((24, 24)).unwrap());
        let settings = TraceSettings { samples: 1024, ..TraceSettings::default() };
        let tracer = Tracer::new(&scene, &settings).unwrap();
        let writer = MemoryWriter::new(tracer.manifest()).unwrap();
        tracer.trace(&writer, &Control::default()).unwrap();
        let gather = Gather::new(writer.snapshot());
        let connections = Connections::new(scene.clone(), gather.dump().manifest()).unwrap().unwrap();
        let lights = bulbs(3);
        let split = connections.split(&lights).unwrap();
        let joined = connections.unit_images(&gather, &lights, &split.emitters, usize::MAX);
        for (light, (_, joined)) in lights.iter().zip(joined) {
            let crossed = gather.unit_images(&[gather.prepare(light).unwrap()], SampleSplit::All);
            let mean = |image: &Image| image.data.iter().sum::<f32>() / image.data.len() as f32;
            eprintln!("{} {}", mean(&crossed[0]), mean(&joined));
        }
    }
}
