//! Lights connected to a few paths of each block of pixels: means of blocks need fewer than all of their pixels.

use std::sync::Arc;

use rayon::prelude::*;
use relume_dump::Pass;
use relume_gather::{Balance, Emitter, Gather, GatherError, PreparedLight};
use relume_scene::Light;
use relume_trace::sampler::PixelSampler;
use relume_trace::{ConnectScratch, PathScratch, PixelVertices};

use crate::device::connections::{Connections, crossed, emitters, limits};

/// Groups of the sampler that choose pixels, one for each half.
const PIXEL_GROUPS: [u32; 2] = [(1 << 27) + 2, (1 << 27) + 3];

/// Vertices of some paths of each block of pixels, in two halves of which no path is in the other, nor in the bake. So what is
/// connected to one half and what crosses the other are independent.
pub(crate) struct BlockVertices {
    connections: Arc<Connections>,
    /// Pixels along the edge of a block.
    edge: usize,
    /// Parts along each edge of a block, of each of which one pixel's paths are there.
    side: usize,
    /// Paths of each of these pixels, for either half.
    passes: [Pass; 2],
    blocks: Vec<[PixelVertices; 2]>,
    balance: Balance,
}

/// Values of the blocks asked for, of some lights by their number and by half.
pub(crate) type BlockHalves = Vec<(usize, [Vec<[f32; 3]>; 2])>;

impl BlockVertices {
    /// Traces about `side` times `side` paths of each block for either half. Nothing if `stop` ended it.
    pub fn new(
        connections: &Arc<Connections>,
        edge: usize,
        side: usize,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        let manifest = connections.manifest();
        let paths = side * side;
        let side = side.min(edge);
        let samples = (paths / (side * side)) as u32;
        // Aligned runs are well spread.
        let first = manifest.passes.iter().map(|pass| pass.first_sample + pass.samples).max().unwrap_or(0);
        let first = first.next_multiple_of(2 * samples);
        let passes = [0, 1].map(|half| Pass { first_sample: first + half * samples, samples });
        let crossed = manifest.samples() * (edge * edge) as u32;
        let mut new = Self {
            connections: Arc::clone(connections),
            edge,
            side,
            passes,
            blocks: Vec::new(),
            balance: Balance { connected: 2 * samples * (side * side) as u32, crossed },
        };
        let trace = |scratch: &mut PathScratch, block: usize| {
            let of_half = |(half, pass): (usize, Pass)| {
                let pixels = new.pixels(block, half).map(|(pixel, _)| pixel);
                connections.tracer().path_vertices(pixels, pass, limits(samples), scratch)
            };
            (!stop()).then(|| [(0, passes[0]), (1, passes[1])].map(of_half))
        };
        let (columns, rows) = new.size();
        let blocks = (0..columns * rows).into_par_iter().map_init(PathScratch::default, trace);
        new.blocks = blocks.collect::<Option<_>>()?;
        Some(new)
    }

    /// Columns and rows of blocks.
    pub fn size(&self) -> (usize, usize) {
        let manifest = self.connections.manifest();
        (manifest.width.div_ceil(self.edge), manifest.height.div_ceil(self.edge))
    }

    /// Pixels of a block whose paths are there for a half, and the share of the block that each stands for.
    fn pixels(&self, block: usize, half: usize) -> impl Iterator<Item = ((usize, usize), f32)> {
        let manifest = self.connections.manifest();
        let (columns, (edge, side)) = (self.size().0, (self.edge, self.side));
        let [left, top] = [block % columns, block / columns].map(|place| place * edge);
        // Blocks and their parts are cut at the right and the bottom.
        let within = |first: usize, length: usize, end: usize| length.min(end.saturating_sub(first));
        let along = move |first: usize, part: usize, end: usize| {
            let [begin, next] = [part, part + 1].map(|part| part * edge / side);
            (first + begin, within(first + begin, next - begin, end))
        };
        let area = within(left, edge, manifest.width) * within(top, edge, manifest.height);
        (0..side * side).filter_map(move |number| {
            let (x, width) = along(left, number % side, manifest.width);
            let (y, height) = along(top, number / side, manifest.height);
            let [u, v, ..] = PixelSampler::new(manifest.seed, x as u32, y as u32).draw(0, PIXEL_GROUPS[half]);
            let inside = |u: f32, length: usize| (u * length as f32) as usize;
            let share = (width * height) as f32 / area as f32;
            (share > 0.0).then(|| ((x + inside(u, width), y + inside(v, height)), share))
        })
    }

    /// Those of some lights that are connected, by their number.
    ///
    /// # Errors
    /// If a light is none: see [`PreparedLight::new`].
    pub fn emitters(&self, lights: &[Light]) -> Result<Vec<(usize, Emitter)>, GatherError> {
        emitters(lights, self.connections.manifest(), self.balance)
    }

    /// Lights made ready for a gather of the bake, without what is connected of them.
    ///
    /// # Errors
    /// If a light is none: see [`PreparedLight::new`].
    pub fn crossed(&self, gather: &Gather, lights: &[Light]) -> Result<Vec<PreparedLight>, GatherError> {
        crossed(gather, lights, self.balance)
    }

    /// Connected parts of the means of some blocks, of radiance 1, by either half.
    ///
    /// # Errors
    /// If a light is none: see [`PreparedLight::new`].
    pub fn halves(&self, lights: &[Light], blocks: &[u32]) -> Result<BlockHalves, GatherError> {
        let numbered = self.emitters(lights)?;
        let emitters: Vec<&Emitter> = numbered.iter().map(|(_, emitter)| emitter).collect();
        let of_block = |scratch: &mut ConnectScratch, block: &u32| {
            [0, 1].map(|half| self.block(*block as usize, half, &emitters, scratch))
        };
        let by_block: Vec<[Vec<[f32; 3]>; 2]> =
            blocks.par_iter().map_init(ConnectScratch::default, of_block).collect();
        let of_light = |(i, (number, _)): (usize, &(usize, Emitter))| {
            (*number, [0, 1].map(|half| by_block.iter().map(|halves| halves[half][i]).collect()))
        };
        Ok(numbered.iter().enumerate().map(of_light).collect())
    }

    fn block(
        &self,
        block: usize,
        half: usize,
        lights: &[&Emitter],
        scratch: &mut ConnectScratch,
    ) -> Vec<[f32; 3]> {
        let mut means = vec![[0.0; 3]; lights.len()];
        if lights.is_empty() {
            return means;
        }
        let (vertices, pass) = (&self.blocks[block][half], self.passes[half]);
        for (number, (pixel, share)) in self.pixels(block, half).enumerate() {
            let scale = share / pass.samples as f32;
            self.connections.connect(
                (vertices.pixel(number), pixel, pass),
                lights,
                scratch,
                |light, value| {
                    means[light].iter_mut().zip(value).for_each(|(mean, value)| *mean += scale * value);
                },
            );
        }
        means
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_box::{bulbs, closed_box};
    use glam::Vec3;
    use relume_dump::MemoryWriter;
    use relume_gather::SampleSplit;
    use relume_image::Image;
    use relume_scene::{LightShape, Scene};
    use relume_trace::{Control, TraceSettings, Tracer};

    const SIZE: (usize, usize) = (58, 37);

    fn baked(scene: &Scene, samples: u32, seed: u64) -> Gather {
        let tracer =
            Tracer::new(scene, &TraceSettings { samples, seed, ..TraceSettings::default() }).unwrap();
        let writer = MemoryWriter::new(tracer.manifest()).unwrap();
        tracer.trace(&writer, &Control::default()).unwrap();
        Gather::new(writer.snapshot())
    }

    /// Crossings and connections of a light together, by half.
    fn both(gather: &Gather, vertices: &BlockVertices, light: &Light) -> [Image; 2] {
        let lights = std::slice::from_ref(light);
        let (columns, rows) = vertices.size();
        let blocks: Vec<u32> = (0..(columns * rows) as u32).collect();
        let mut connected = vertices.halves(lights, &blocks).unwrap();
        let crossed = vertices.crossed(gather, lights).unwrap();
        let mut halves = [SampleSplit::First, SampleSplit::Second]
            .map(|half| gather.unit_images(&crossed, half).remove(0).shrunk(vertices.edge));
        for (half, connected) in halves.iter_mut().zip(connected.remove(0).1) {
            assert_eq!(half.data.len(), 3 * connected.len());
            half.data.iter_mut().zip(connected.as_flattened()).for_each(|(sum, value)| *sum += value);
        }
        halves
    }

    #[test]
    fn halves_of_blocks_are_independent_and_have_the_mean_of_crossings() {
        let scene = Arc::new(closed_box(SIZE).unwrap());
        let own = baked(&scene, 32, 0);
        let references = [1, 2].map(|seed| baked(&scene, 256, seed));
        let connections = Connections::new(scene, own.dump().manifest(), None, 1).unwrap();
        let connections = Arc::new(connections);
        let small = LightShape::Sphere { center: Vec3::new(0.3, -0.4, 0.2), radius: 0.02 };
        let panel = LightShape::Quad {
            center: Vec3::new(0.2, 0.1, 0.9),
            edge_u: Vec3::Y * 0.8,
            edge_v: Vec3::X * 0.8,
            spread: std::f32::consts::PI,
        };
        let lights = [Light::unit(small), Light::unit(panel), bulbs(1).remove(0)];
        for (edge, side) in [(1, 2), (2, 4), (3, 4), (8, 4)] {
            let vertices = BlockVertices::new(&connections, edge, side, &|| false).unwrap();
            assert_eq!(vertices.size(), (SIZE.0.div_ceil(edge), SIZE.1.div_ceil(edge)));
            for light in &lights {
                let halves = both(&own, &vertices, light);
                let errors: [Vec<f64>; 2] = [0, 1].map(|half| {
                    let reference = &references[half];
                    let reference = reference
                        .unit_images(&[reference.prepare(light).unwrap()], SampleSplit::All)
                        .remove(0)
                        .shrunk(edge);
                    // Channels of a grey box are all alike.
                    let pairs = halves[half].data.iter().zip(&reference.data).step_by(3);
                    pairs.map(|(found, expected)| f64::from(found - expected)).collect()
                });
                let count = errors[0].len() as f64;
                let sum_of = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
                for errors in &errors {
                    let mean = errors.iter().sum::<f64>() / count;
                    let standard_error = (sum_of(errors, errors) / count / count).sqrt();
                    assert!(mean.abs() < 4.0 * standard_error, "{edge} {mean} +- {standard_error} {light:?}");
                }
                let [first, second] = &errors;
                let correlation =
                    sum_of(first, second) / (sum_of(first, first) * sum_of(second, second)).sqrt();
                assert!(correlation.abs() < 4.0 / count.sqrt(), "{edge} {correlation} {light:?}");
            }
        }
    }
}
