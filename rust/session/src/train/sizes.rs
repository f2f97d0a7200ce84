use crate::bake::features::{camera, pixel_features};
use crate::error::SessionError;
use crate::files::light_set::LightSet;
use relume_dump::Dump;
use relume_proxy::{LightKind, SizeRange};
use relume_scene::Light;
use std::path::Path;

/// Sizes of lights that are worth learning for a bake, by the lights of its scene ([`sizes_with`]).
///
/// # Errors
/// If the bake or its lights cannot be read.
pub fn default_sizes(bake: &Path, kind: LightKind) -> Result<SizeRange, SessionError> {
    sizes_with(bake, kind, &LightSet::of_bake(bake)?.lights)
}

/// Radii of 1/200 to 1/10 of the visible scene, or edges of 1/50 to 1/5 of it. They are widened to include some lights
/// of this kind, with half as much again on both sides.
///
/// # Errors
/// If the bake cannot be read.
pub(crate) fn sizes_with(bake: &Path, kind: LightKind, lights: &[Light]) -> Result<SizeRange, SessionError> {
    let dump = Dump::open(bake)?;
    let (low, high) = pixel_features(&dump.aovs(), &camera(dump.manifest())?).visible_bounds();
    let extent = low.distance(high).max(1e-3);
    let mut range = match kind {
        LightKind::Quad | LightKind::Ellipse => SizeRange { min: extent / 50.0, max: extent / 5.0 },
        _ => SizeRange { min: extent / 200.0, max: extent / 10.0 },
    };
    const SLACK: f32 = 1.5;
    let of_kind = lights.iter().filter(|light| LightKind::of_light(light) == Some(kind));
    for size in of_kind.flat_map(|light| kind.sizes(&light.shape)) {
        range = SizeRange { min: range.min.min(size / SLACK), max: range.max.max(size * SLACK) };
    }
    Ok(range)
}
