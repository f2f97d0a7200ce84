use glam::Vec3;
use rayon::prelude::*;
use relume_dump::Dump;
use relume_image::Image;
use relume_scene::{Light, LightShape};

use crate::balance::Balance;
use crate::kernel::{self, Isa, KernelWork, Sink};
use crate::light::PreparedLight;
use crate::rules::with_rules;
use crate::{GatherError, SampleSplit};

/// Sums lights over a dump (paper, sections 3.1 and 4.2): for every segment that crosses a light, throughput times
/// radiance. Exact, and noisy where few segments cross the light.
///
/// All images are *unit images*: of radiance 1, to be weighted with the lights' radiances afterwards ([`crate::relight`]).
/// Results do not depend on the number of threads or the instruction set.
#[derive(Clone, Debug)]
pub struct Gather {
    pub(crate) dump: Dump,
    /// Box around all vertices.
    pub(crate) bounds: (Vec3, Vec3),
    floor: f32,
    pub(crate) isa: Isa,
}

impl Gather {
    /// The radius floor ([`PreparedLight::new`]) is one step of the coarsest position grid: the rounding of positions blurs
    /// smaller lights by as much.
    pub fn new(dump: Dump) -> Self {
        let step = dump.shards().map(|shard| shard.grid().step().max_element()).fold(0.0, f32::max);
        let boxes = dump.shards().map(|shard| (shard.grid().min, shard.grid().max));
        let bounds = boxes.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or_default();
        Self { dump, bounds, floor: step, isa: Isa::detect() }
    }

    /// Raises the radius floor, in metres: less noise from tiny lights, at the price of a wider penumbra.
    #[must_use]
    pub fn with_radius_floor(self, floor: f32) -> Self {
        Self { floor: self.floor.max(floor), ..self }
    }

    /// Uses other instructions than the best of this processor; those that it lacks are replaced by the portable ones.
    #[must_use]
    pub fn with_isa(self, isa: Isa) -> Self {
        let isa = if Isa::available().contains(&isa) { isa } else { Isa::Portable };
        Self { isa, ..self }
    }

    /// Gather for one half of the samples: whole passes where they split evenly, so that no pixel is searched for the
    /// place of the cut, else the half itself.
    pub fn split(&self, half: SampleSplit) -> (Self, SampleSplit) {
        let passes = &self.dump.manifest().passes;
        let sums = passes.iter().scan(0, |sum, pass| {
            *sum += pass.samples;
            Some(*sum)
        });
        let total: u32 = passes.iter().map(|pass| pass.samples).sum();
        let is_complete = self.dump.complete_passes() == passes.len();
        let cut = sums.take_while(|sum| 2 * sum <= total).enumerate().find(|(_, sum)| 2 * sum == total);
        let passes = match (half, cut) {
            (SampleSplit::First, Some((last, _))) if is_complete => 0..last + 1,
            (SampleSplit::Second, Some((last, _))) if is_complete => last + 1..passes.len(),
            _ => return (self.clone(), half),
        };
        (Self { dump: self.dump.passes(passes), ..self.clone() }, SampleSplit::All)
    }

    /// The dump.
    pub fn dump(&self) -> &Dump {
        &self.dump
    }

    /// Smallest radius that is gathered as it is, metres.
    pub fn radius_floor(&self) -> f32 {
        self.floor
    }

    /// The radius, or half of an edge, that a light is gathered with which is smaller than [`Gather::radius_floor`], metres; none
    /// for others.
    pub fn enlarged(&self, shape: &LightShape) -> Option<f32> {
        let least = match *shape {
            LightShape::Sphere { radius, .. }
            | LightShape::FacingDisk { radius, .. }
            | LightShape::Spot { radius, .. }
            | LightShape::StretchedSpot { radius, .. } => radius,
            LightShape::Quad { edge_u, edge_v, .. }
            | LightShape::Ellipse { edge_u, edge_v, .. }
            | LightShape::Sheared { edge_u, edge_v, .. } => 0.5 * edge_u.length().min(edge_v.length()),
            LightShape::Sun { .. } => return None,
        };
        (least < self.floor).then_some(self.floor)
    }

    /// Makes a light ready; once per change of its shape, factors, receivers or rules.
    ///
    /// # Errors
    /// See [`PreparedLight::new`].
    pub fn prepare(&self, light: &Light) -> Result<PreparedLight, GatherError> {
        PreparedLight::new(&with_rules(light, self.dump.manifest()), self.floor)
    }

    /// [`Gather::prepare`] for a light that is connected, too ([`Emitter`](crate::Emitter)).
    ///
    /// # Errors
    /// See [`PreparedLight::new`].
    pub fn prepare_balanced(&self, light: &Light, balance: Balance) -> Result<PreparedLight, GatherError> {
        Ok(self.prepare(light)?.balanced(balance))
    }

    /// [`Gather::prepare`] for many.
    ///
    /// # Errors
    /// Error of the first light that cannot be gathered.
    pub fn prepare_all(&self, lights: &[Light]) -> Result<Vec<PreparedLight>, GatherError> {
        lights.iter().map(|light| self.prepare(light)).collect()
    }

    /// One unit image per light, RGB, in one pass over the dump on all threads of the current pool. Tiles without
    /// samples are black.
    pub fn unit_images(&self, lights: &[PreparedLight], half: SampleSplit) -> Vec<Image> {
        let manifest = self.dump.manifest();
        let tiles: Vec<_> =
            (0..manifest.tile_count()).into_par_iter().map(|tile| self.tile(tile, lights, half)).collect();
        (0..lights.len()).into_par_iter().map(|light| self.assemble(&tiles, light)).collect()
    }

    /// The image of one of several lights from the values of all tiles, light by light, then pixel by pixel.
    pub fn assemble(&self, tiles: &[Vec<[f32; 3]>], light: usize) -> Image {
        let manifest = self.dump.manifest();
        let mut image = Image::new(manifest.width, manifest.height, 3);
        for (tile, values) in tiles.iter().enumerate() {
            let rect = manifest.tile_rect(tile);
            let pixels = &values[light * rect.pixel_count()..][..rect.pixel_count()];
            for (row, pixels) in pixels.chunks_exact(rect.width).enumerate() {
                let start = ((rect.y + row) * manifest.width + rect.x) * 3;
                image.data[start..start + rect.width * 3].copy_from_slice(pixels.as_flattened());
            }
        }
        image
    }

    /// Unit values of a tile, light by light, then pixel by pixel.
    pub fn tile(&self, tile: usize, lights: &[PreparedLight], half: SampleSplit) -> Vec<[f32; 3]> {
        let pixels = self.dump.manifest().tile_rect(tile).pixel_count();
        let mut sums = vec![[0.0; 3]; lights.len() * pixels];
        let mut work = KernelWork::default();
        for shard in self.dump.tile(tile) {
            let mut sink =
                TileSink { offsets: shard.pixel_offsets(), sums: &mut sums, first: 0, pixel: 0, light: 0 };
            for records in half.shard_records(shard) {
                kernel::visit(self.isa, shard, records, &mut work, lights, &mut sink);
            }
        }
        let scale = 1.0 / half.tile_samples(&self.dump, tile).max(1) as f32;
        sums.as_flattened_mut().iter_mut().for_each(|sum| *sum *= scale);
        sums
    }

    /// Unit values of one pixel, one per light.
    pub fn pixel(&self, x: usize, y: usize, lights: &[PreparedLight], half: SampleSplit) -> Vec<[f32; 3]> {
        let mut values = vec![[0.0; 3]; lights.len()];
        self.pixel_into(x, y, lights, half, &mut GatherScratch::default(), &mut values);
        values
    }

    /// [`Gather::pixel`] without allocation, for the inner loop of a training: `values` is as long as `lights`.
    pub fn pixel_into(
        &self,
        x: usize,
        y: usize,
        lights: &[PreparedLight],
        half: SampleSplit,
        scratch: &mut GatherScratch,
        values: &mut [[f32; 3]],
    ) {
        let (tile, pixel) = self.dump.locate(x, y);
        values.fill([0.0; 3]);
        for shard in self.dump.tile(tile) {
            let records = half.records(shard, pixel);
            let mut sink = SumSink { values, light: 0 };
            kernel::visit(self.isa, shard, records, &mut scratch.0, lights, &mut sink);
        }
        let scale = 1.0 / half.tile_samples(&self.dump, tile).max(1) as f32;
        values.as_flattened_mut().iter_mut().for_each(|value| *value *= scale);
    }
}

/// Working memory of [`Gather::pixel_into`], one per thread.
#[derive(Debug, Default)]
pub struct GatherScratch(KernelWork);

struct TileSink<'a> {
    offsets: &'a [u32],
    /// Light by light, then pixel by pixel.
    sums: &'a mut [[f32; 3]],
    /// Pixel of the block's first record.
    first: usize,
    pixel: usize,
    light: usize,
}

impl Sink for TileSink<'_> {
    fn begin_block(&mut self, first_record: usize) {
        self.first = self.offsets.partition_point(|&offset| offset as usize <= first_record) - 1;
    }

    fn begin_light(&mut self, light: usize) {
        (self.light, self.pixel) = (light, self.first);
    }

    fn add(&mut self, record: usize, contribution: Vec3) {
        while self.offsets[self.pixel + 1] as usize <= record {
            self.pixel += 1;
        }
        let pixels = self.offsets.len() - 1;
        add(&mut self.sums[self.light * pixels + self.pixel], contribution);
    }
}

/// Adds up all records.
pub(crate) struct SumSink<'a> {
    /// Light by light.
    pub values: &'a mut [[f32; 3]],
    pub light: usize,
}

impl Sink for SumSink<'_> {
    fn begin_block(&mut self, _first_record: usize) {}

    fn begin_light(&mut self, light: usize) {
        self.light = light;
    }

    fn add(&mut self, _record: usize, contribution: Vec3) {
        add(&mut self.values[self.light], contribution);
    }
}

pub(crate) fn add(sum: &mut [f32; 3], contribution: Vec3) {
    for (sum, value) in sum.iter_mut().zip(contribution.to_array()) {
        *sum += value;
    }
}
