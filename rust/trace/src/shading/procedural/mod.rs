//! Blender's procedural textures, evaluated as Cycles does: its formulas and constants, checked at many points by
//! `tests/cycles_reference.rs`.

mod arrays;
mod hash;
mod noise;
mod patterns;
mod voronoi;

use glam::{Vec3, Vec4};
use relume_scene::{Dimensions, Procedural};

use super::values::Inputs;
use hash::random_color;
use noise::Octaves;
use patterns::{Bricks, Distortion};
use voronoi::Voronoi;

/// Most octaves after the first.
const MAX_DETAIL: f32 = 15.0;

/// A texture at the point `at`, in four numbers: colour in xyz, and in w factor, distance or radius; see
/// [`Procedural::Voronoi`] for positions. Colours may be left out, but for their red, unless `colored`.
pub fn evaluate(texture: &Procedural, at: Vec3, inputs: &impl Inputs, colored: bool) -> Vec4 {
    let float = |input| inputs.float(input);
    let color = |input| inputs.vector(input);
    match texture {
        Procedural::Noise { .. } => noise(texture, at, inputs, colored),
        Procedural::Voronoi { .. } => voronoi(texture, at, inputs, colored),
        Procedural::Wave { .. } => wave(texture, at, inputs),
        Procedural::Brick { .. } => brick(texture, at, inputs),
        Procedural::WhiteNoise { dimensions, w, .. } => {
            let Vec3 { x, y, z } = at;
            let color = match dimensions {
                Dimensions::One => random_color([float(w)]),
                Dimensions::Two => random_color([x, y]),
                Dimensions::Three => random_color([x, y, z]),
                Dimensions::Four => random_color([x, y, z, float(w)]),
            };
            color.extend(1.0)
        }
        Procedural::Checker { color1, color2, scale, .. } => {
            let is_first = patterns::checker(at * float(scale));
            color(if is_first { color1 } else { color2 }).extend(f32::from(is_first))
        }
        Procedural::Gradient { kind, .. } => Vec4::splat(patterns::gradient(*kind, at)),
        Procedural::Magic { depth, scale, distortion, .. } => {
            patterns::magic(at * float(scale), *depth, float(distortion))
        }
    }
}

fn noise(texture: &Procedural, at: Vec3, inputs: &impl Inputs, colored: bool) -> Vec4 {
    let Procedural::Noise {
        dimensions,
        kind,
        normalize,
        vector: _,
        w,
        scale,
        detail,
        roughness,
        lacunarity,
        offset,
        gain,
        distortion,
    } = texture
    else {
        return Vec4::ZERO;
    };
    let float = |input| inputs.float(input);
    let octaves = Octaves {
        kind: *kind,
        normalize: *normalize,
        detail: float(detail).clamp(0.0, MAX_DETAIL),
        roughness: float(roughness).max(0.0),
        lacunarity: float(lacunarity),
        offset: float(offset),
        gain: float(gain),
    };
    let (scale, distortion) = (float(scale), float(distortion));
    let Vec3 { x, y, z } = at * scale;
    match dimensions {
        Dimensions::One => noise::texture([float(w) * scale], &octaves, distortion, colored),
        Dimensions::Two => noise::texture([x, y], &octaves, distortion, colored),
        Dimensions::Three => noise::texture([x, y, z], &octaves, distortion, colored),
        Dimensions::Four => noise::texture([x, y, z, float(w) * scale], &octaves, distortion, colored),
    }
}

fn voronoi(texture: &Procedural, at: Vec3, inputs: &impl Inputs, colored: bool) -> Vec4 {
    let Procedural::Voronoi {
        dimensions,
        feature,
        metric,
        hash,
        normalize,
        position,
        vector: _,
        w,
        scale,
        detail,
        roughness,
        lacunarity,
        smoothness,
        exponent,
        randomness,
    } = texture
    else {
        return Vec4::ZERO;
    };
    let float = |input| inputs.float(input);
    let scale = float(scale);
    let voronoi = Voronoi {
        feature: *feature,
        metric: *metric,
        hash: *hash,
        normalize: *normalize,
        position: *position,
        colored,
        scale,
        detail: float(detail).clamp(0.0, MAX_DETAIL),
        roughness: float(roughness).clamp(0.0, 1.0),
        lacunarity: float(lacunarity),
        smoothness: (float(smoothness) * 0.5).clamp(0.0, 0.5),
        exponent: float(exponent),
        randomness: float(randomness).clamp(0.0, 1.0),
    };
    let Vec3 { x, y, z } = at * scale;
    match dimensions {
        Dimensions::One => voronoi.evaluate([float(w) * scale]),
        Dimensions::Two => voronoi.evaluate([x, y]),
        Dimensions::Three => voronoi.evaluate([x, y, z]),
        Dimensions::Four => voronoi.evaluate([x, y, z, float(w) * scale]),
    }
}

fn wave(texture: &Procedural, at: Vec3, inputs: &impl Inputs) -> Vec4 {
    let Procedural::Wave {
        kind,
        direction,
        profile,
        vector: _,
        scale,
        distortion,
        detail,
        detail_scale,
        detail_roughness,
        phase_offset,
    } = texture
    else {
        return Vec4::ZERO;
    };
    let float = |input| inputs.float(input);
    let distortion = Distortion {
        strength: float(distortion),
        scale: float(detail_scale),
        octaves: Octaves::doubling(float(detail).clamp(0.0, MAX_DETAIL), float(detail_roughness).max(0.0)),
    };
    let shape = (*kind, *direction, *profile);
    Vec4::splat(patterns::wave(shape, at * float(scale), float(phase_offset), &distortion))
}

fn brick(texture: &Procedural, at: Vec3, inputs: &impl Inputs) -> Vec4 {
    let Procedural::Brick {
        offset,
        offset_frequency,
        squash,
        squash_frequency,
        vector: _,
        color1,
        color2,
        mortar,
        scale,
        mortar_size,
        mortar_smooth,
        bias,
        brick_width,
        row_height,
    } = texture
    else {
        return Vec4::ZERO;
    };
    let float = |input| inputs.float(input);
    let bricks = Bricks {
        width: float(brick_width),
        row_height: float(row_height),
        offset: *offset,
        offset_frequency: *offset_frequency,
        squash: *squash,
        squash_frequency: *squash_frequency,
        mortar_size: float(mortar_size),
        mortar_smooth: float(mortar_smooth),
        bias: float(bias),
    };
    let (tint, factor) = bricks.tint_and_mortar((at * float(scale)).truncate());
    let brick = inputs.vector(color1).lerp(inputs.vector(color2), tint);
    brick.lerp(inputs.vector(mortar), factor).extend(factor)
}
