//! Targets by connection, where the scene of a bake is at hand.

use std::sync::Arc;

use glam::Vec3;
use relume_gather::{Balance, Emitter, Gather, GatherError, PreparedLight, SampleSplit};
use relume_proxy::Rng;
use relume_scene::Light;
use relume_trace::{ConnectScratch, UnpackedVertex};

use crate::device::connections::{Connections, connect};

/// Levels whose vertices lights are connected to: eight paths of each pixel.
const LEVELS: usize = 4;
/// Vertices that a light is connected to for one target: of those that are met first, and of all others.
const DRAWN: [usize; 2] = [1, 2];
/// Stream of the random numbers that choose vertices, and points on lights.
const STREAM: u64 = 0x636f_6e6e;

/// Lights of single pixels, each connected to a few random vertices of the pixel for each target: many noisy targets teach a network
/// more than few good ones.
pub(super) struct ConnectedPixels {
    connections: Arc<Connections>,
    levels: usize,
    balance: Balance,
}

impl ConnectedPixels {
    /// Makes the vertices ready where they are not; `split` are the paths whose crossings count beside them. Nothing if
    /// `stop` ended it.
    pub fn new(
        connections: Arc<Connections>,
        gather: &Gather,
        split: SampleSplit,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        let levels = connections.keep(LEVELS, stop)?;
        let balance = Balance { connected: DRAWN[0] as u32, crossed: split.tile_samples(gather.dump(), 0) };
        Some(Self { connections, levels, balance })
    }

    /// A light made ready for a gather without what is connected of it, and that; none if all of it counts by crossings.
    ///
    /// # Errors
    /// See [`PreparedLight::new`].
    pub fn prepare(
        &self,
        gather: &Gather,
        light: &Light,
    ) -> Result<(PreparedLight, Option<Emitter>), GatherError> {
        if !Emitter::covers(light, self.connections.manifest()) {
            return Ok((gather.prepare(light)?, None));
        }
        let emitter = Emitter::new(light, self.connections.manifest(), self.balance)?;
        Ok((gather.prepare_balanced(light, self.balance)?, Some(emitter)))
    }

    /// Connected part of a light at a pixel, a number of its tile. `key` chooses the vertices.
    pub fn light(
        &self,
        (tile, pixel): (usize, usize),
        light: &Emitter,
        key: u64,
        scratch: &mut ConnectScratch,
    ) -> [f32; 3] {
        let place = ((tile as u64) << 32) | pixel as u64;
        let mut rng = Rng::stream(STREAM, place, key);
        // Each path is as likely as any other.
        let (vertices, paths) = self.connections.kept(self.levels, tile, rng.next_f32());
        let vertices = vertices.pixel(pixel);
        let (first, later) = vertices.split_at(vertices.partition_point(|vertex| vertex.is_first()));
        let mut sum = Vec3::ZERO;
        for (some, count) in [first, later].into_iter().zip(DRAWN) {
            let count = count.min(some.len());
            let scale = some.len() as f32 / (count.max(1) as f32 * paths as f32);
            for _ in 0..count {
                let vertex = UnpackedVertex::new(&some[rng.below(some.len() as u32) as usize]);
                let numbers = std::array::from_fn(|_| rng.next_f32());
                sum += scale * connect(self.connections.tracer(), &vertex, light, numbers, scratch);
            }
        }
        sum.to_array()
    }
}

#[cfg(test)]
mod tests {

    use relume_dump::MemoryWriter;
    use relume_proxy::{PixelQueries, TargetSource};
    use relume_scene::{LightShape, Scene};
    use relume_trace::{Control, TraceSettings, Tracer};

    use super::*;
    use crate::relight::denoise::Denoise;
    use crate::test_box::closed_box;
    use crate::train::targets::DumpTargets;

    const SIZE: (usize, usize) = (24, 18);

    fn baked(scene: &Scene, samples: u32, seed: u64) -> Gather {
        let settings = TraceSettings { samples, seed, ..TraceSettings::default() };
        let tracer = Tracer::new(scene, &settings).unwrap();
        let writer = MemoryWriter::new(tracer.manifest()).unwrap();
        tracer.trace(&writer, &Control::default()).unwrap();
        Gather::new(writer.snapshot())
    }

    /// Mean error of targets of all pixels, its standard error, and the mean square.
    fn errors(targets: &DumpTargets, reference: &Gather, light: LightShape) -> [f64; 3] {
        let pixels: Vec<u32> = (0..(SIZE.0 * SIZE.1) as u32).collect();
        let lights = vec![light; pixels.len()];
        let mut values = vec![[0.0; 3]; pixels.len()];
        let queries = PixelQueries { pixels: &pixels, lights_per_pixel: 1, lights: &lights };
        targets.pixel_targets(&queries, &mut values).unwrap();
        let prepared = reference.prepare(&Light::unit(light)).unwrap();
        let expected = reference.unit_images(&[prepared], SampleSplit::All).remove(0);
        // Channels of a grey box are all alike.
        let errors = values.iter().zip(expected.data.chunks_exact(3)).map(|(a, b)| f64::from(a[0] - b[0]));
        let (sum, squares) =
            errors.fold((0.0, 0.0), |(sum, squares), error| (sum + error, squares + error * error));
        let count = pixels.len() as f64;
        [sum / count, (squares / count / count).sqrt(), squares / count]
    }

    #[test]
    fn connected_targets_have_the_mean_of_crossings_and_less_noise_of_small_lights() {
        let scene = Arc::new(closed_box(SIZE).unwrap());
        let (own, reference) = (baked(&scene, 32, 0), baked(&scene, 2048, 1));
        let connections = Connections::new(scene, own.dump().manifest(), None, 1).unwrap();
        let connected =
            ConnectedPixels::new(Arc::new(connections), &own, SampleSplit::All, &|| false).unwrap();
        let denoise = Denoise::new(&own.dump().aovs(), None);
        let crossings = || DumpTargets::new(&own, SampleSplit::All, (Vec3::NEG_ONE, Vec3::ONE), &denoise);
        let crossed = crossings();
        let both = crossings().with_pixels_connected(Some(&connected));
        let sphere = |radius| LightShape::Sphere { center: Vec3::new(0.3, -0.4, 0.2), radius };
        for (radius, most) in [(0.04, 0.1), (0.5, 1.5)] {
            let by_crossings = errors(&crossed, &reference, sphere(radius));
            let [mean, standard_error, square] = errors(&both, &reference, sphere(radius));
            assert!(mean.abs() < 4.0 * standard_error, "{radius} {mean} +- {standard_error}");
            assert!(square < most * by_crossings[2], "{radius} {square} {by_crossings:?}");
        }
    }
}
