//! Blender's procedural textures, evaluated as Cycles does: its formulas and constants, checked at many points by
//! `tests/cycles_reference.rs`.

mod arrays;
mod gabor;
mod hash;
mod noise;
mod patterns;
mod radial_tiling;
mod voronoi;

use glam::{Vec3, Vec4};
use relume_scene::{BrickTexture, Dimensions, NoiseTexture, Procedural, VoronoiTexture, WaveTexture};

use super::values::NodeInputs;
use hash::random_color;
pub(super) use hash::random_of_words;
use noise::Octaves;
use patterns::{Bricks, Distortion};
use voronoi::Voronoi;

/// Most octaves after the first.
const MAX_DETAIL: f32 = 15.0;

/// A texture at the point `at`, in four numbers: colour in xyz, and in w factor, distance or radius; see
/// [`VoronoiTexture`] for positions. Colours may be left out, but for their red, unless `colored`.
pub fn evaluate(texture: &Procedural, at: Vec3, inputs: &impl NodeInputs, colored: bool) -> Vec4 {
    let float = |input| inputs.float(input);
    let color = |input| inputs.vector(input);
    match texture {
        Procedural::Noise(texture) => noise(texture, at, inputs, colored),
        Procedural::Voronoi(texture) => voronoi(texture, at, inputs, colored),
        Procedural::Wave(texture) => wave(texture, at, inputs),
        Procedural::Brick(texture) => brick(texture, at, inputs),
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
        Procedural::Gabor { dimensions, scale, frequency, anisotropy, orientation, direction, .. } => {
            let at = at * float(scale);
            let waves = gabor::Waves {
                frequency: float(frequency).max(0.001),
                isotropy: 1.0 - float(anisotropy).clamp(0.0, 1.0),
            };
            match dimensions {
                Dimensions::Three => gabor::space(at, &waves, color(direction).normalize()),
                _ => gabor::plane(at.truncate(), &waves, float(orientation)),
            }
        }
        Procedural::RadialTiling { normalize, segment, sides, roundness, .. } => {
            let polygon = radial_tiling::Polygon {
                sides: float(sides).max(2.0),
                roundness: float(roundness).clamp(0.0, 1.0),
                normalize: *normalize,
            };
            if *segment { polygon.segment(at.truncate()) } else { polygon.coordinates(at.truncate()) }
        }
        Procedural::Magic { depth, scale, distortion, .. } => {
            patterns::magic(at * float(scale), *depth, float(distortion))
        }
    }
}

fn noise(texture: &NoiseTexture, at: Vec3, inputs: &impl NodeInputs, colored: bool) -> Vec4 {
    let float = |input| inputs.float(input);
    let octaves = Octaves {
        kind: texture.kind,
        normalize: texture.normalize,
        detail: float(&texture.detail).clamp(0.0, MAX_DETAIL),
        roughness: float(&texture.roughness).max(0.0),
        lacunarity: float(&texture.lacunarity),
        offset: float(&texture.offset),
        gain: float(&texture.gain),
    };
    let (scale, distortion) = (float(&texture.scale), float(&texture.distortion));
    let Vec3 { x, y, z } = at * scale;
    match texture.dimensions {
        Dimensions::One => noise::texture([float(&texture.w) * scale], &octaves, distortion, colored),
        Dimensions::Two => noise::texture([x, y], &octaves, distortion, colored),
        Dimensions::Three => noise::texture([x, y, z], &octaves, distortion, colored),
        Dimensions::Four => {
            noise::texture([x, y, z, float(&texture.w) * scale], &octaves, distortion, colored)
        }
    }
}

fn voronoi(texture: &VoronoiTexture, at: Vec3, inputs: &impl NodeInputs, colored: bool) -> Vec4 {
    let float = |input| inputs.float(input);
    let scale = float(&texture.scale);
    let voronoi = Voronoi {
        feature: texture.feature,
        metric: texture.metric,
        hash: texture.hash,
        normalize: texture.normalize,
        position: texture.position,
        colored,
        scale,
        detail: float(&texture.detail).clamp(0.0, MAX_DETAIL),
        roughness: float(&texture.roughness).clamp(0.0, 1.0),
        lacunarity: float(&texture.lacunarity),
        smoothness: (float(&texture.smoothness) * 0.5).clamp(0.0, 0.5),
        exponent: float(&texture.exponent),
        randomness: float(&texture.randomness).clamp(0.0, 1.0),
    };
    let Vec3 { x, y, z } = at * scale;
    match texture.dimensions {
        Dimensions::One => voronoi.evaluate([float(&texture.w) * scale]),
        Dimensions::Two => voronoi.evaluate([x, y]),
        Dimensions::Three => voronoi.evaluate([x, y, z]),
        Dimensions::Four => voronoi.evaluate([x, y, z, float(&texture.w) * scale]),
    }
}

fn wave(texture: &WaveTexture, at: Vec3, inputs: &impl NodeInputs) -> Vec4 {
    let float = |input| inputs.float(input);
    let distortion = Distortion {
        strength: float(&texture.distortion),
        scale: float(&texture.detail_scale),
        octaves: Octaves::doubling(
            float(&texture.detail).clamp(0.0, MAX_DETAIL),
            float(&texture.detail_roughness).max(0.0),
        ),
    };
    let shape = (texture.kind, texture.direction, texture.profile);
    Vec4::splat(patterns::wave(shape, at * float(&texture.scale), float(&texture.phase_offset), &distortion))
}

fn brick(texture: &BrickTexture, at: Vec3, inputs: &impl NodeInputs) -> Vec4 {
    let float = |input| inputs.float(input);
    let bricks = Bricks {
        width: float(&texture.brick_width),
        row_height: float(&texture.row_height),
        offset: texture.offset,
        offset_frequency: texture.offset_frequency,
        squash: texture.squash,
        squash_frequency: texture.squash_frequency,
        mortar_size: float(&texture.mortar_size),
        mortar_smooth: float(&texture.mortar_smooth),
        bias: float(&texture.bias),
    };
    let (tint, factor) = bricks.tint_and_mortar((at * float(&texture.scale)).truncate());
    let brick = inputs.vector(&texture.color1).lerp(inputs.vector(&texture.color2), tint);
    brick.lerp(inputs.vector(&texture.mortar), factor).extend(factor)
}
