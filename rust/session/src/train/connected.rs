//! Targets by connection, where the scene of a bake is at hand.

use std::sync::Arc;

use rayon::prelude::*;
use relume_dump::Pass;
use relume_gather::{Balance, Emitter, Gather, GatherError, PreparedLight, SampleSplit};
use relume_proxy::Rng;
use relume_scene::Light;
use relume_trace::{ConnectScratch, PathScratch, PixelVertices};

use crate::device::connections::{Connections, connect, limits};

/// Paths of each pixel whose vertices are kept.
const PATHS: u32 = 8;
/// Vertices that a light is connected to for one target: those that are met first, and others.
const DRAWN: [usize; 2] = [1, 2];
/// Stream of the random numbers that choose vertices, and points on lights.
const STREAM: u64 = 0x636f_6e6e;

/// Vertices of a few paths of each pixel, of which no path is in the bake. A light is connected to some of them for each target: many
/// noisy ones teach a network more than few good ones.
pub(super) struct TargetVertices {
    connections: Arc<Connections>,
    tiles: Vec<PixelVertices>,
    balance: Balance,
}

impl TargetVertices {
    /// Traces them; `split` are the paths whose crossings count beside them. Nothing if `stop` ended it.
    pub fn new(
        connections: &Arc<Connections>,
        gather: &Gather,
        split: SampleSplit,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        let manifest = connections.manifest();
        // Aligned runs are well spread.
        let first = manifest.passes.iter().map(|pass| pass.first_sample + pass.samples).max().unwrap_or(0);
        let pass = Pass { first_sample: first.next_multiple_of(PATHS), samples: PATHS };
        let trace = |scratch: &mut PathScratch, tile: usize| {
            let pixels = manifest.tile_rect(tile).pixels();
            (!stop()).then(|| connections.tracer().path_vertices(pixels, pass, limits(PATHS), scratch))
        };
        let tiles = (0..manifest.tile_count()).into_par_iter().map_init(PathScratch::default, trace);
        let balance = Balance { connected: DRAWN[0] as u32, crossed: split.tile_samples(gather.dump(), 0) };
        Some(Self { connections: Arc::clone(connections), tiles: tiles.collect::<Option<_>>()?, balance })
    }

    /// A light made ready for a gather, without what is connected of it, and the rest of it; none if all of it counts by crossings.
    ///
    /// # Errors
    /// See [`PreparedLight::new`].
    pub fn prepare(&self, gather: &Gather, light: &Light) -> Result<(PreparedLight, Option<Emitter>), GatherError> {
        if !Emitter::covers(light) {
            return Ok((gather.prepare(light)?, None));
        }
        let emitter = Emitter::new(light, self.connections.manifest(), self.balance)?;
        Ok((gather.prepare_balanced(light, self.balance)?, Some(emitter)))
    }

    /// Adds what is connected of some lights to their values at a pixel, a number of its tile. The same lights, by their
    /// keys, are connected to the same vertices.
    pub fn add(
        &self,
        (tile, pixel): (usize, usize),
        lights: &[(u64, Option<Emitter>)],
        values: &mut [[f32; 3]],
        scratch: &mut ConnectScratch,
    ) {
        let vertices = self.tiles[tile].pixel(pixel);
        let (first, later) = vertices.split_at(vertices.partition_point(|vertex| vertex.is_first()));
        let place = ((tile as u64) << 32) | pixel as u64;
        for ((key, light), value) in lights.iter().zip(values) {
            let Some(light) = light else { continue };
            let mut rng = Rng::stream(STREAM, place, *key);
            for (some, count) in [first, later].into_iter().zip(DRAWN) {
                let drawn = count.min(some.len());
                let scale = some.len() as f32 / (drawn.max(1) as f32 * PATHS as f32);
                for _ in 0..drawn {
                    let vertex = &some[rng.below(some.len() as u32) as usize];
                    let numbers = std::array::from_fn(|_| rng.next_f32());
                    let light = connect(self.connections.tracer(), vertex, light, numbers, scratch);
                    value.iter_mut().zip((scale * light).to_array()).for_each(|(sum, light)| *sum += light);
                }
            }
        }
    }
}
