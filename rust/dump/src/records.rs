//! Samples checked and packed into the records of a shard.

use glam::Vec3;

use crate::packing::{self, Flags, Grid, Start};
use crate::samples::{SampleRecord, TileSamples};
use crate::{End, Lobe, Manifest, RECEIVER_LIMIT};

/// Refuses samples that do not fit the manifest, are too many, or are not finite.
pub(crate) fn check_samples(
    manifest: &Manifest,
    tile: usize,
    pass: usize,
    samples: &TileSamples,
) -> Result<(), String> {
    let (rect, expected) = (manifest.tile_rect(tile), manifest.passes[pass].samples as usize);
    if samples.rect() != rect || samples.aov.len() != rect.pixel_count() {
        return Err(format!("{} of {} pixels, or another tile", samples.aov.len(), rect.pixel_count()));
    }
    if u32::try_from(samples.records.len()).is_err() {
        return Err("more than 2^32 segments; use smaller tiles or passes".into());
    }
    let count = samples.records.len();
    if samples.pixel_starts[0] != 0 {
        return Err("a path was begun before the first pixel".into());
    }
    let ends = samples.pixel_starts[1..].iter().chain([&count]);
    for (pixel, (&start, &end)) in samples.pixel_starts.iter().zip(ends).enumerate() {
        let records = &samples.records[start..end];
        let paths = records.iter().filter(|record| record.path_start).count();
        if paths != expected || !records.first().is_some_and(|record| record.path_start) {
            return Err(format!("pixel {pixel} has {paths} paths instead of {expected}"));
        }
        if let Some(reason) = records.iter().find_map(|record| record_fault(record, manifest)) {
            return Err(format!("{reason} in pixel {pixel}"));
        }
        if records.windows(2).any(|pair| pair[1].continues && pair[0].lobe.is_none()) {
            return Err(format!("a segment continues no ray in pixel {pixel}"));
        }
        if !samples.aov[pixel].iter().all(|value| value.is_finite()) {
            return Err(format!(
                "an AOV is not finite in pixel {pixel}; lower the strength of what glows there, or in sight of it"
            ));
        }
    }
    Ok(())
}

fn record_fault(record: &SampleRecord, manifest: &Manifest) -> Option<&'static str> {
    let finite = match record.end {
        End::Vertex(vertex) => vertex.is_finite(),
        End::Escape(direction) => direction.is_finite() && direction.length_squared() > 0.5,
    };
    if !finite || !record.throughput.is_finite() {
        return Some("a segment is not finite");
    }
    if record.path_start && (record.continues || record.lobe.is_some_and(|lobe| lobe != Lobe::Camera)) {
        return Some("the first segment of a path is not the camera's");
    }
    let receivers = manifest.receiver_count();
    let known = receivers == 0 || usize::from(record.receiver) < receivers;
    (record.receiver >= RECEIVER_LIMIT || !known).then_some("a segment has an unknown receiver")
}

/// Box of all vertices; a box without extent at the origin if there are none.
pub(crate) fn bounds(records: &[SampleRecord]) -> Grid {
    let vertices = records.iter().filter_map(|record| match record.end {
        End::Vertex(vertex) => Some(vertex),
        End::Escape(_) => None,
    });
    let join = |grid: Grid, v: Vec3| Grid { min: grid.min.min(v), max: grid.max.max(v) };
    let empty = Grid { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
    let grid = vertices.fold(empty, join);
    if grid.min.is_finite() { grid } else { Grid { min: Vec3::ZERO, max: Vec3::ZERO } }
}

/// Both words of a record.
pub(crate) fn pack(record: &SampleRecord, grid: &Grid) -> [u32; 2] {
    let start = match record {
        SampleRecord { path_start: true, .. } => Start::Camera,
        SampleRecord { continues: true, .. } => Start::Ray,
        _ => Start::Vertex,
    };
    let flags = |escaped| match record.lobe {
        Some(lobe) => Flags::segment(start, escaped, lobe, record.receiver),
        None => Flags::origin(),
    };
    match record.end {
        End::Vertex(vertex) => {
            let [x, y, z] = grid.encode(vertex).map(u32::from);
            [x | y << 16, z | u32::from(flags(false).0) << 16]
        }
        End::Escape(direction) => [packing::encode_direction(direction), u32::from(flags(true).0) << 16],
    }
}
