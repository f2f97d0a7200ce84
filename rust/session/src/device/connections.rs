//! Lights connected to the vertices of a dump's paths, where the scene that they were traced in is at hand.

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;
use relume_dump::{Manifest, Pass};
use relume_gather::{Emitter, Gather, GatherError};
use relume_image::Image;
use relume_scene::{Light, Scene};
use relume_trace::sampler::PixelSampler;
use relume_trace::{ConnectScratch, PathScratch, TileVertices, TraceSettings, Tracer, VertexLimits};
use self_cell::self_cell;

use crate::error::SessionError;

self_cell!(
    struct OwnedTracer {
        owner: Arc<Scene>,
        #[covariant]
        dependent: Tracer,
    }
);

/// A scene that lights can be connected in.
pub(crate) struct ConnectedScene(OwnedTracer);

impl ConnectedScene {
    /// Makes a scene ready; none if its lights have to be summed over crossings alone.
    ///
    /// # Errors
    /// If the scene has too many triangles.
    pub fn new(scene: Arc<Scene>, settings: &TraceSettings) -> Result<Option<Self>, SessionError> {
        let traced = OwnedTracer::try_new(scene, |scene| Tracer::new(scene, settings))?;
        Ok(traced.borrow_dependent().connects().then_some(Self(traced)))
    }

    /// The scene that a dump was traced in; see [`Self::new`].
    ///
    /// # Errors
    /// If the scene is another one than the dump's.
    pub fn of_bake(scene: Arc<Scene>, manifest: &Manifest) -> Result<Option<Self>, SessionError> {
        let fail = |reason: &str| Err(SessionError::Settings(format!("the scene is not that of the bake: {reason}")));
        if scene.hash() != manifest.scene_hash {
            return fail("its hash differs");
        }
        let Ok(paths) = serde_json::from_value(manifest.settings.clone()) else {
            return fail("its settings are of another Relume");
        };
        Self::new(scene, &TraceSettings { paths, seed: manifest.seed, ..TraceSettings::default() })
    }

    fn tracer(&self) -> &Tracer<'_> {
        self.0.borrow_dependent()
    }
}

/// Diffuse vertices of the paths of a dump, traced tile by tile where they are first asked for.
pub(crate) struct Connections {
    scene: Arc<ConnectedScene>,
    manifest: Manifest,
    pass: Pass,
    limits: VertexLimits,
    tiles: Vec<OnceLock<TileVertices>>,
}

/// Lights, each divided into what is connected and what is summed over crossings.
pub(crate) struct SplitLights {
    /// Numbers of the lights that are connected, with their diffuse part.
    pub emitters: Vec<(usize, Emitter)>,
    /// What remains of all lights.
    pub rest: Vec<Light>,
}

/// Group of the sampler whose numbers choose points on lights.
const LIGHT_GROUP: u32 = 1 << 25;

impl Connections {
    /// Vertices of the first paths of a dump.
    pub fn new(scene: Arc<ConnectedScene>, manifest: &Manifest, limits: VertexLimits) -> Self {
        let first_sample = manifest.passes.first().map_or(0, |pass| pass.first_sample);
        let most = 2 * limits.first.max(limits.later) as u32;
        let pass = Pass { first_sample, samples: manifest.samples().min(most) };
        let tiles = (0..manifest.tile_count()).map(|_| OnceLock::new()).collect();
        Self { scene, manifest: manifest.clone(), pass, limits, tiles }
    }

    /// Divides lights into what is connected and what is not.
    ///
    /// # Errors
    /// If a light is none: see [`relume_gather::PreparedLight::new`].
    pub fn split(&self, lights: &[Light]) -> Result<SplitLights, GatherError> {
        let mut split = SplitLights { emitters: Vec::new(), rest: lights.to_vec() };
        for (number, rest) in split.rest.iter_mut().enumerate().filter(|(_, light)| light.lobes.diffuse != 0.0) {
            if let Some(emitter) = Emitter::new(rest, &self.manifest)? {
                rest.lobes.diffuse = 0.0;
                split.emitters.push((number, emitter));
            }
        }
        Ok(split)
    }

    /// Diffuse parts of unit images; `gather` is of the same dump.
    pub fn unit_images(&self, gather: &Gather, lights: &[(usize, Emitter)]) -> Vec<(usize, Image)> {
        let tiles: Vec<Vec<[f32; 3]>> =
            (0..self.tiles.len()).into_par_iter().map(|tile| self.tile(tile, lights)).collect();
        let image = |(light, (number, _)): (usize, &(usize, Emitter))| (*number, gather.assemble(&tiles, light));
        lights.iter().enumerate().map(image).collect()
    }

    /// Values of a tile, light by light, then pixel by pixel.
    fn tile(&self, tile: usize, lights: &[(usize, Emitter)]) -> Vec<[f32; 3]> {
        let rect = self.manifest.tile_rect(tile);
        let tracer = self.scene.tracer();
        let trace = || tracer.diffuse_vertices(rect, self.pass, self.limits, &mut PathScratch::default());
        let vertices = self.tiles[tile].get_or_init(trace);
        let mut scratch = ConnectScratch::default();
        let mut sums = vec![[0.0; 3]; lights.len() * rect.pixel_count()];
        let scale = 1.0 / self.pass.samples as f32;
        for pixel in 0..rect.pixel_count() {
            let (x, y) = (rect.x + pixel % rect.width, rect.y + pixel / rect.width);
            let sampler = PixelSampler::new(self.manifest.seed, x as u32, y as u32);
            for (number, vertex) in vertices.pixel(pixel).iter().enumerate() {
                let [u, v, ..] = sampler.draw(self.pass.first_sample + number as u32, LIGHT_GROUP);
                for (light, (_, emitter)) in lights.iter().enumerate() {
                    let factor = emitter.factor(vertex.receiver) * scale;
                    if factor == 0.0 {
                        continue;
                    }
                    let Some(sample) = emitter.sample(vertex.position, vertex.normal(), [u, v]) else { continue };
                    let seen = tracer.connect(vertex, sample.direction, sample.distance, &mut scratch);
                    let added = (seen * sample.radiance * factor).to_array();
                    let sum = &mut sums[light * rect.pixel_count() + pixel];
                    sum.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
                }
            }
        }
        sums
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
        let connected = Arc::new(ConnectedScene::new(scene.clone(), &settings).unwrap().unwrap());
        let connections = Connections::new(connected, gather.dump().manifest(), VertexLimits::default());
        let lights = bulbs(3);
        let split = connections.split(&lights).unwrap();
        let joined = connections.unit_images(&gather, &split.emitters);
        for (light, (_, joined)) in lights.iter().zip(joined) {
            let crossed = gather.unit_images(&[gather.prepare(light).unwrap()], SampleSplit::All);
            let mean = |image: &Image| image.data.iter().sum::<f32>() / image.data.len() as f32;
            eprintln!("{} {}", mean(&crossed[0]), mean(&joined));
        }
    }
}
