//! Blender's procedural textures, as nodes of a shader graph.

use crate::Input;
use crate::sockets::with_sockets;

/// Number of coordinates that a texture varies with (names of Blender's enum). 1D takes `w`, 4D the vector and `w`.
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

/// Combination of the octaves of a noise texture (names of Blender's `noise_type`).
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

/// Measure of a Voronoi texture (names of Blender's `feature`).
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

/// Source of the random points of a Voronoi texture of two and more dimensions.
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

/// Direction of a wave texture: bands along it, rings about it (names of Blender's enums). `Diagonal` counts for bands
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

with_sockets! {
    /// A Noise Texture node.
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[expect(missing_docs, reason = "the sockets and properties of Blender's node")]
    pub struct NoiseTexture {
        pub dimensions: Dimensions,
        pub kind: NoiseKind,
        pub normalize: bool,
        pub vector: Option<Input>,
        pub w: Input,
        pub scale: Input,
        pub detail: Input,
        pub roughness: Input,
        pub lacunarity: Input,
        pub offset: Input,
        pub gain: Input,
        pub distortion: Input,
    }
}

with_sockets! {
    /// A Voronoi Texture node. Its colour and distance are one node here, the position of the cell's point another.
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[expect(missing_docs, reason = "the sockets and properties of Blender's node")]
    pub struct VoronoiTexture {
        pub dimensions: Dimensions,
        pub feature: VoronoiFeature,
        pub metric: Metric,
        pub hash: VoronoiHash,
        pub normalize: bool,
        /// True if the outputs are vector (Blender's Position) and w, not color and distance.
        pub position: bool,
        pub vector: Option<Input>,
        pub w: Input,
        pub scale: Input,
        pub detail: Input,
        pub roughness: Input,
        pub lacunarity: Input,
        pub smoothness: Input,
        pub exponent: Input,
        pub randomness: Input,
    }
}

with_sockets! {
    /// A Wave Texture node.
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[expect(missing_docs, reason = "the sockets and properties of Blender's node")]
    pub struct WaveTexture {
        pub kind: WaveKind,
        pub direction: WaveDirection,
        pub profile: WaveProfile,
        pub vector: Option<Input>,
        pub scale: Input,
        pub distortion: Input,
        pub detail: Input,
        pub detail_scale: Input,
        pub detail_roughness: Input,
        pub phase_offset: Input,
    }
}

with_sockets! {
    /// A Brick Texture node.
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[expect(missing_docs, reason = "the sockets and properties of Blender's node")]
    pub struct BrickTexture {
        pub offset: f32,
        pub offset_frequency: u32,
        pub squash: f32,
        pub squash_frequency: u32,
        pub vector: Option<Input>,
        pub color1: Input,
        pub color2: Input,
        pub mortar: Input,
        pub scale: Input,
        pub mortar_size: Input,
        pub mortar_smooth: Input,
        pub bias: Input,
        pub brick_width: Input,
        pub row_height: Input,
    }
}

with_sockets! {
    /// A procedural texture. Fields carry Blender's socket names; a `vector` of `None` is the generated coordinate. Outputs are
    /// factor and color unless said otherwise.
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[serde(tag = "texture", rename_all = "snake_case")]
    #[expect(missing_docs, reason = "the sockets and properties of Blender's nodes of the same name")]
    pub enum Procedural {
        Noise(NoiseTexture),
        /// Outputs value and color.
        WhiteNoise {
            dimensions: Dimensions,
            vector: Option<Input>,
            w: Input,
        },
        /// The factor is 1 where the first colour is shown.
        Checker {
            vector: Option<Input>,
            color1: Input,
            color2: Input,
            scale: Input,
        },
        Gradient {
            kind: GradientKind,
            vector: Option<Input>,
        },
        /// Outputs distance and color, or vector and w if `position`; for [`VoronoiFeature::NSphereRadius`] radius.
        Voronoi(VoronoiTexture),
        Wave(WaveTexture),
        Magic {
            depth: u32,
            vector: Option<Input>,
            scale: Input,
            distortion: Input,
        },
        /// Value in x, phase in y and intensity in z. `orientation` is an angle in 2D, `direction` a vector in 3D.
        Gabor {
            dimensions: Dimensions,
            vector: Option<Input>,
            scale: Input,
            frequency: Input,
            anisotropy: Input,
            orientation: Input,
            direction: Input,
        },
        /// Segments around a point: coordinates within a segment and its number in w; or with `segment` its width in x and its
        /// rotation in y.
        RadialTiling {
            normalize: bool,
            segment: bool,
            vector: Option<Input>,
            sides: Input,
            roundness: Input,
        },
        /// The factor is 1 on mortar.
        Brick(BrickTexture),
    }
}

impl Procedural {
    /// Coordinate of the texture; `None` is the generated one.
    pub fn vector(&self) -> &Option<Input> {
        match self {
            Self::Noise(NoiseTexture { vector, .. })
            | Self::WhiteNoise { vector, .. }
            | Self::Checker { vector, .. }
            | Self::Gradient { vector, .. }
            | Self::Voronoi(VoronoiTexture { vector, .. })
            | Self::Wave(WaveTexture { vector, .. })
            | Self::Magic { vector, .. }
            | Self::Gabor { vector, .. }
            | Self::RadialTiling { vector, .. }
            | Self::Brick(BrickTexture { vector, .. }) => vector,
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::sockets::Sockets;
    use crate::{NodeId, Output};

    /// Every socket of a texture, made a link to a node of its own in JSON, is visited once: a forgotten one would be
    /// left out of what is evaluated.
    #[track_caller]
    fn assert_visits_all(settings: Value, sockets: &str) {
        let mut value = settings;
        let sockets: Vec<&str> = sockets.split(' ').collect();
        for (node, socket) in sockets.iter().enumerate() {
            value[*socket] = json!({ "node": node, "output": "value" });
        }
        let mut texture: Procedural = serde_json::from_value(value).expect("a texture");
        let mut visited = Vec::new();
        texture.visit_sockets(&mut |input| {
            if let Input::Link { node, output: Output::Value } = input {
                visited.push(*node);
            }
        });
        visited.sort_unstable();
        assert_eq!(visited, (0..sockets.len() as NodeId).collect::<Vec<_>>());
    }

    #[test]
    fn every_socket_is_visited() {
        assert_visits_all(
            json!({"texture": "noise", "dimensions": "4D", "kind": "FBM", "normalize": true}),
            "vector w scale detail roughness lacunarity offset gain distortion",
        );
        assert_visits_all(json!({"texture": "white_noise", "dimensions": "1D"}), "vector w");
        assert_visits_all(json!({"texture": "checker"}), "vector color1 color2 scale");
        assert_visits_all(json!({"texture": "gradient", "kind": "QUADRATIC_SPHERE"}), "vector");
        assert_visits_all(
            json!({"texture": "voronoi", "dimensions": "2D", "feature": "SMOOTH_F1", "metric": "MINKOWSKI",
                   "hash": "pcg", "normalize": false, "position": false}),
            "vector w scale detail roughness lacunarity smoothness exponent randomness",
        );
        assert_visits_all(
            json!({"texture": "wave", "kind": "RINGS", "direction": "SPHERICAL", "profile": "SAW"}),
            "vector scale distortion detail detail_scale detail_roughness phase_offset",
        );
        assert_visits_all(json!({"texture": "magic", "depth": 2}), "vector scale distortion");
        assert_visits_all(
            json!({"texture": "brick", "offset": 0.5, "offset_frequency": 2, "squash": 1.0, "squash_frequency": 2}),
            "vector color1 color2 mortar scale mortar_size mortar_smooth bias brick_width row_height",
        );
    }
}
