//! Parts of a light's picture by how its paths scatter first after the camera, as Cycles parts its light passes
//! (`kernel/film/light_passes.h`).

use glam::Vec3;
use rayon::prelude::*;
use relume_dump::{Flags, Lobe, Shard};
use relume_image::Image;
use relume_scene::LobeFactors;

use crate::SampleSplit;
use crate::gather::{Gather, add};
use crate::kernel::{self, KernelWork, Sink};
use crate::light::PreparedLight;

/// Part of a light's picture: by the lobe of the first scattering after the camera, and by whether the light is met right after that.
/// Transparent surfaces do not count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum LobePart {
    /// The light itself, as the camera sees it.
    Emission,
    /// Diffuse reflection of the light, and what comes through translucent surfaces.
    DiffuseDirect,
    /// Diffuse reflection of what the light lights, and what comes through translucent surfaces.
    DiffuseIndirect,
    /// Glossy reflection of the light, and what Principled Hair scatters of it.
    GlossyDirect,
    /// Glossy reflection of what the light lights, and what Principled Hair scatters of it.
    GlossyIndirect,
    /// The light through glass.
    TransmissionDirect,
    /// Light of lit surfaces through glass.
    TransmissionIndirect,
    /// The light, scattered in a volume.
    VolumeDirect,
    /// Light of lit surfaces, scattered in a volume.
    VolumeIndirect,
}

impl LobePart {
    /// Every part; the index is its number.
    pub const ALL: [Self; 9] = [
        Self::Emission,
        Self::DiffuseDirect,
        Self::DiffuseIndirect,
        Self::GlossyDirect,
        Self::GlossyIndirect,
        Self::TransmissionDirect,
        Self::TransmissionIndirect,
        Self::VolumeDirect,
        Self::VolumeIndirect,
    ];

    /// Part of light that a path collects which scatters first by `first`, [`Lobe::Camera`] if it does not; directly after that, or
    /// later.
    pub fn of(first: Lobe, is_direct: bool) -> Self {
        match (first.ray_kind(), is_direct) {
            (Lobe::Camera, _) => Self::Emission,
            (Lobe::Diffuse, true) => Self::DiffuseDirect,
            (Lobe::Diffuse, false) => Self::DiffuseIndirect,
            (Lobe::Glossy | Lobe::RoughGlossy, true) => Self::GlossyDirect,
            (Lobe::Glossy | Lobe::RoughGlossy, false) => Self::GlossyIndirect,
            (Lobe::Transmission | Lobe::RoughTransmission, true) => Self::TransmissionDirect,
            (Lobe::Transmission | Lobe::RoughTransmission, false) => Self::TransmissionIndirect,
            (Lobe::Volume, true) => Self::VolumeDirect,
            (Lobe::Volume, false) => Self::VolumeIndirect,
        }
    }

    /// Its name in files, which is Cycles'.
    pub fn name(self) -> &'static str {
        match self {
            Self::Emission => "Emission",
            Self::DiffuseDirect => "Diffuse Direct",
            Self::DiffuseIndirect => "Diffuse Indirect",
            Self::GlossyDirect => "Glossy Direct",
            Self::GlossyIndirect => "Glossy Indirect",
            Self::TransmissionDirect => "Transmission Direct",
            Self::TransmissionIndirect => "Transmission Indirect",
            Self::VolumeDirect => "Volume Direct",
            Self::VolumeIndirect => "Volume Indirect",
        }
    }
}

/// Factor of a light on what a lobe sees of it.
pub(crate) fn factor_of(factors: &LobeFactors, lobe: Lobe) -> f32 {
    match lobe {
        Lobe::Camera => factors.camera,
        Lobe::Diffuse => factors.diffuse,
        Lobe::Glossy | Lobe::RoughGlossy => factors.glossy,
        Lobe::Transmission | Lobe::RoughTransmission => factors.transmission,
        Lobe::Volume => factors.volume,
    }
}

impl Gather {
    /// The unit image of a light in its parts, in the order of [`LobePart::ALL`]. They add up to that of [`Self::unit_images`].
    pub fn part_images(&self, light: &PreparedLight) -> Vec<Image> {
        let tiles = 0..self.dump.manifest().tile_count();
        let tiles: Vec<_> = tiles.into_par_iter().map(|tile| self.tile_parts(tile, light)).collect();
        (0..LobePart::ALL.len()).map(|part| self.assemble(&tiles, part)).collect()
    }

    /// Values of a tile, part by part, then pixel by pixel.
    fn tile_parts(&self, tile: usize, light: &PreparedLight) -> Vec<[f32; 3]> {
        let pixels = self.dump.manifest().tile_rect(tile).pixel_count();
        let mut sums = vec![[0.0; 3]; LobePart::ALL.len() * pixels];
        let mut work = KernelWork::default();
        for shard in self.dump.tile(tile) {
            let parts = parts_of(shard);
            let offsets = shard.pixel_offsets();
            let mut sink = PartSink { offsets, parts: &parts, sums: &mut sums, first: 0, pixel: 0 };
            let lights = std::slice::from_ref(light);
            for records in SampleSplit::All.shard_records(shard) {
                kernel::visit(self.isa, shard, records, &mut work, lights, &mut sink);
            }
        }
        let scale = 1.0 / SampleSplit::All.tile_samples(&self.dump, tile).max(1) as f32;
        sums.as_flattened_mut().iter_mut().for_each(|sum| *sum *= scale);
        sums
    }
}

/// Adds what a single light gives to its parts.
struct PartSink<'a> {
    offsets: &'a [u32],
    /// Part of each record.
    parts: &'a [LobePart],
    /// Part by part, then pixel by pixel.
    sums: &'a mut [[f32; 3]],
    /// Pixel of the block's first record.
    first: usize,
    pixel: usize,
}

impl Sink for PartSink<'_> {
    fn begin_block(&mut self, first_record: usize) {
        self.first = self.offsets.partition_point(|&offset| offset as usize <= first_record) - 1;
    }

    fn begin_light(&mut self, _light: usize) {
        self.pixel = self.first;
    }

    fn add(&mut self, record: usize, contribution: Vec3) {
        while self.offsets[self.pixel + 1] as usize <= record {
            self.pixel += 1;
        }
        let pixels = self.offsets.len() - 1;
        add(&mut self.sums[self.parts[record] as usize * pixels + self.pixel], contribution);
    }
}

/// Bits of a packed throughput that are all 0 if it is.
const MANTISSAS: u32 = (1 << 27) - 1;

/// Part that light along each segment of a shard counts for.
///
/// A path may record the ray after its first scattering several times over, for lights with rules of their own: all start at the same
/// place. Records without weight only lead to where the next one starts. So light is indirect from the first ray on that starts
/// elsewhere. Behind a portal that place is another, too: light counts as indirect there.
fn parts_of(shard: &Shard) -> Vec<LobePart> {
    let mut parts = Vec::with_capacity(shard.throughput().len());
    // Lobe of the first scattering, and the place that its ray starts from.
    let mut first: Option<(Lobe, [u32; 2])> = None;
    let mut is_direct = true;
    let mut place = [0; 2];
    let positions = shard.position_xy().iter().zip(shard.position_z_flags());
    for ((xy, z_flags), throughput) in positions.zip(shard.throughput()) {
        let flags = Flags((z_flags >> 16) as u16);
        if flags.path_start() {
            (first, is_direct) = (None, true);
        }
        let lobe = flags.lobe().filter(|lobe| *lobe != Lobe::Camera && throughput & MANTISSAS != 0);
        match (lobe, first) {
            (Some(lobe), None) => first = Some((lobe, place)),
            (Some(_), Some((_, origin))) => is_direct &= flags.continues() || place == origin,
            (None, _) => {}
        }
        parts.push(first.map_or(LobePart::Emission, |(lobe, _)| LobePart::of(lobe, is_direct)));
        place = [*xy, z_flags & 0xffff];
    }
    parts
}
