//! Blender's procedural textures, as nodes of a shader graph.

use crate::Input;

/// How many coordinates a texture varies with (names of Blender's enum). 1D takes `w`, 4D the vector and `w`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum Dimensions {
    #[serde(rename = "1D")]
    One,
    #[serde(rename = "2D")]
    Two,
    #[serde(rename = "3D")]
    Three,
    #[serde(rename = "4D")]
    Four,
}

/// How a noise texture joins its octaves (names of Blender's `noise_type`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum NoiseKind {
    Fbm,
    Multifractal,
    RidgedMultifractal,
    HybridMultifractal,
    HeteroTerrain,
}

/// Shapes of a gradient texture (names of Blender's `gradient_type`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum GradientKind {
    Linear,
    Quadratic,
    Easing,
    Diagonal,
    Spherical,
    QuadraticSphere,
    Radial,
}

/// What a Voronoi texture measures (names of Blender's `feature`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum VoronoiFeature {
    F1,
    F2,
    #[serde(rename = "SMOOTH_F1")]
    SmoothF1,
    DistanceToEdge,
    NSphereRadius,
}

/// Distance in a Voronoi texture (names of Blender's `distance`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum Metric {
    Euclidean,
    Manhattan,
    Chebychev,
    Minkowski,
}

/// Where the random points of a Voronoi texture of two and more dimensions come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VoronoiHash {
    /// Before Blender 5.0.
    Jenkins,
    /// Since then.
    Pcg,
}

/// Shape of a wave texture (names of Blender's `wave_type`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum WaveKind {
    Bands,
    Rings,
}

/// Where a wave texture runs: bands along it, rings about it (names of Blender's enums). `Diagonal` counts for bands
/// and `Spherical` for rings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum WaveDirection {
    X,
    Y,
    Z,
    Diagonal,
    Spherical,
}

/// Profile of a wave texture (names of Blender's `wave_profile`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum WaveProfile {
    Sin,
    Saw,
    Tri,
}

/// A procedural texture. Fields carry Blender's socket names. A `vector` of `None` is the generated coordinate.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "texture", rename_all = "snake_case")]
#[expect(missing_docs, reason = "the sockets and properties of Blender's nodes of the same name")]
pub enum Procedural {
    /// Outputs factor and color.
    Noise {
        dimensions: Dimensions,
        kind: NoiseKind,
        normalize: bool,
        vector: Option<Input>,
        w: Input,
        scale: Input,
        detail: Input,
        roughness: Input,
        lacunarity: Input,
        offset: Input,
        gain: Input,
        distortion: Input,
    },
    /// Outputs value and color.
    WhiteNoise { dimensions: Dimensions, vector: Option<Input>, w: Input },
    /// Outputs factor and color.
    Checker { vector: Option<Input>, color1: Input, color2: Input, scale: Input },
    /// Outputs factor and color.
    Gradient { kind: GradientKind, vector: Option<Input> },
    /// Outputs distance and color, or vector (the position of the cell's point) and w if `position`; for
    /// [`VoronoiFeature::NSphereRadius`] radius.
    Voronoi {
        dimensions: Dimensions,
        feature: VoronoiFeature,
        metric: Metric,
        hash: VoronoiHash,
        normalize: bool,
        position: bool,
        vector: Option<Input>,
        w: Input,
        scale: Input,
        detail: Input,
        roughness: Input,
        lacunarity: Input,
        smoothness: Input,
        exponent: Input,
        randomness: Input,
    },
    /// Outputs factor and color.
    Wave {
        kind: WaveKind,
        direction: WaveDirection,
        profile: WaveProfile,
        vector: Option<Input>,
        scale: Input,
        distortion: Input,
        detail: Input,
        detail_scale: Input,
        detail_roughness: Input,
        phase_offset: Input,
    },
    /// Outputs factor and color.
    Magic { depth: u32, vector: Option<Input>, scale: Input, distortion: Input },
    /// Outputs factor (1 on mortar) and color.
    Brick {
        offset: f32,
        offset_frequency: u32,
        squash: f32,
        squash_frequency: u32,
        vector: Option<Input>,
        color1: Input,
        color2: Input,
        mortar: Input,
        scale: Input,
        mortar_size: Input,
        mortar_smooth: Input,
        bias: Input,
        brick_width: Input,
        row_height: Input,
    },
}

impl Procedural {
    /// Where the texture is taken; `None` is the generated coordinate.
    pub fn vector(&self) -> &Option<Input> {
        match self {
            Self::Noise { vector, .. }
            | Self::WhiteNoise { vector, .. }
            | Self::Checker { vector, .. }
            | Self::Gradient { vector, .. }
            | Self::Voronoi { vector, .. }
            | Self::Wave { vector, .. }
            | Self::Magic { vector, .. }
            | Self::Brick { vector, .. } => vector,
        }
    }

    /// Calls `visit` for every input socket.
    pub fn for_each_input(&mut self, mut visit: impl FnMut(&mut Input)) {
        let mut all = |vector: &mut Option<Input>, inputs: &mut [&mut Input]| {
            vector.iter_mut().for_each(&mut visit);
            inputs.iter_mut().for_each(|input| visit(input));
        };
        match self {
            Self::Noise {
                dimensions: _,
                kind: _,
                normalize: _,
                vector,
                w,
                scale,
                detail,
                roughness,
                lacunarity,
                offset,
                gain,
                distortion,
            } => all(vector, &mut [w, scale, detail, roughness, lacunarity, offset, gain, distortion]),
            Self::WhiteNoise { dimensions: _, vector, w } => all(vector, &mut [w]),
            Self::Checker { vector, color1, color2, scale } => all(vector, &mut [color1, color2, scale]),
            Self::Gradient { kind: _, vector } => all(vector, &mut []),
            Self::Voronoi {
                dimensions: _,
                feature: _,
                metric: _,
                hash: _,
                normalize: _,
                position: _,
                vector,
                w,
                scale,
                detail,
                roughness,
                lacunarity,
                smoothness,
                exponent,
                randomness,
            } => {
                all(vector, &mut [w, scale, detail, roughness, lacunarity, smoothness, exponent, randomness])
            }
            Self::Wave {
                kind: _,
                direction: _,
                profile: _,
                vector,
                scale,
                distortion,
                detail,
                detail_scale,
                detail_roughness,
                phase_offset,
            } => all(vector, &mut [scale, distortion, detail, detail_scale, detail_roughness, phase_offset]),
            Self::Magic { depth: _, vector, scale, distortion } => all(vector, &mut [scale, distortion]),
            Self::Brick {
                offset: _,
                offset_frequency: _,
                squash: _,
                squash_frequency: _,
                vector,
                color1,
                color2,
                mortar,
                scale,
                mortar_size,
                mortar_smooth,
                bias,
                brick_width,
                row_height,
            } => {
                all(vector, &mut [color1, color2, mortar, scale, mortar_size, mortar_smooth]);
                all(&mut None, &mut [bias, brick_width, row_height]);
            }
        }
    }
}
