//! Shader graphs: Blender's nodes that decide how a surface scatters, in topological order.
//!
//! The exporter flattens groups and reroutes, folds constants, bakes ramps and curves to tables, and names what it
//! could not translate in [`crate::Scene::warnings`]. A graph is evaluated front to back for each hit.

use crate::Procedural;

/// Index into [`Material::nodes`]; a node refers only to nodes before it.
pub type NodeId = u32;

/// A surface shader.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Material {
    /// Blender material name.
    pub name: String,
    /// Nodes; links point backwards only.
    pub nodes: Vec<Node>,
    /// The closure node that is the surface; nothing is a black absorber.
    pub surface: Option<NodeId>,
}

/// An input socket: a value or a link. In JSON: `0.5`, `[r, g, b]` or `{"node": 3, "output": "color"}`.
/// Conversions are Blender's: colour to float by luminance, vector to float by average, float to three equal values.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(untagged)]
pub enum Input {
    /// A float.
    Float(f32),
    /// A colour or vector.
    Rgb([f32; 3]),
    /// Another node's output.
    Link {
        /// Which node.
        node: NodeId,
        /// Which of its outputs.
        output: Output,
    },
}

/// Output sockets of value nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the socket names of Blender's nodes")]
pub enum Output {
    Color,
    Alpha,
    Value,
    Vector,
    Normal,
    Fresnel,
    Facing,
    Position,
    TrueNormal,
    Incoming,
    Backfacing,
    Tangent,
    Location,
    ObjectIndex,
    Random,
    X,
    Y,
    Z,
    W,
    Factor,
    Distance,
    Radius,
}

/// Microfacet distribution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// Single scattering GGX.
    Ggx,
    /// GGX with energy compensation (Blender's default).
    #[default]
    MultiGgx,
    /// Beckmann.
    Beckmann,
    /// Ashikhmin-Shirley.
    AshikhminShirley,
}

/// How an image's alpha is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Alpha {
    /// Colour is not multiplied by alpha.
    #[default]
    Straight,
    /// Colour is multiplied by alpha.
    Premultiplied,
    /// Colour and alpha are unrelated channels.
    ChannelPacked,
    /// Alpha is ignored and reads 1.
    None,
}

/// Texture Coordinate outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TexCoord {
    /// The render UV map.
    Uv,
    /// Object space position.
    Object,
    /// Position in 0..1 of the object-space bounding box.
    Generated,
    /// Object space shading normal.
    Normal,
    /// Camera space position.
    Camera,
    /// Position on the film, 0..1.
    Window,
    /// World-space reflection vector.
    Reflection,
}

/// What a Mapping node does with its vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MappingKind {
    /// Scale, rotate, translate.
    Point,
    /// Inverse of Point.
    Texture,
    /// Scale, rotate.
    Vector,
    /// Inverse scale, rotate, normalise.
    Normal,
}

/// Space of a normal map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NormalSpace {
    /// Tangent space of a UV map.
    Tangent,
    /// Object space.
    Object,
    /// World space.
    World,
    /// Object space, Blender's old axes.
    BlenderObject,
    /// World space, Blender's old axes.
    BlenderWorld,
}

/// Data type of a Mix node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MixData {
    /// Floats.
    Float,
    /// Vectors, one factor.
    Vector,
    /// Vectors, a factor a component.
    VectorNonUniform,
    /// Colours, with a blend mode.
    Color,
}

/// Blend modes of a colour Mix (names of Blender's `blend_type`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum BlendMode {
    Mix,
    Darken,
    Multiply,
    Burn,
    Lighten,
    Screen,
    Dodge,
    Add,
    Overlay,
    SoftLight,
    LinearLight,
    Difference,
    Exclusion,
    Subtract,
    Divide,
    Hue,
    Saturation,
    Color,
    Value,
}

/// Operations of a Math node (names of Blender's `operation`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum MathOp {
    Add,
    Subtract,
    Multiply,
    Divide,
    MultiplyAdd,
    Power,
    Logarithm,
    Sqrt,
    InverseSqrt,
    Absolute,
    Exponent,
    Minimum,
    Maximum,
    LessThan,
    GreaterThan,
    Sign,
    Compare,
    SmoothMin,
    SmoothMax,
    Round,
    Floor,
    Ceil,
    Trunc,
    Fract,
    Modulo,
    FlooredModulo,
    Wrap,
    Snap,
    Pingpong,
    Sine,
    Cosine,
    Tangent,
    Arcsine,
    Arccosine,
    Arctangent,
    Arctan2,
    Sinh,
    Cosh,
    Tanh,
    Radians,
    Degrees,
}

/// Operations of a Vector Math node (names of Blender's `operation`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum VectorMathOp {
    Add,
    Subtract,
    Multiply,
    Divide,
    MultiplyAdd,
    CrossProduct,
    Project,
    Reflect,
    DotProduct,
    Distance,
    Length,
    Scale,
    Normalize,
    Absolute,
    Minimum,
    Maximum,
    Floor,
    Ceil,
    Fraction,
    Modulo,
    Snap,
    Sine,
    Cosine,
    Tangent,
}

/// Interpolation of a Map Range node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum MapRangeKind {
    /// Straight line.
    Linear,
    /// Quantised by `steps`.
    Stepped,
    /// Hermite.
    Smoothstep,
    /// Fifth order.
    Smootherstep,
}

/// A baked table over `min..max`.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Curve {
    /// Position of the first entry.
    pub min: f32,
    /// Position of the last entry.
    pub max: f32,
    /// RGBA entries, evenly spaced.
    pub table: Vec<[f32; 4]>,
    /// Interpolate between entries (false: constant ramps).
    pub interpolate: bool,
    /// Continue the end slopes outside.
    pub extrapolate: bool,
}

/// A shader node. Fields carry Blender's socket names and units. A `normal` of `None` is the shading normal.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
#[expect(missing_docs, reason = "the sockets and properties of Blender's nodes of the same name")]
#[expect(clippy::large_enum_variant, reason = "a scene has a few hundred nodes")]
pub enum Node {
    // Closures.
    Principled {
        base_color: Input,
        metallic: Input,
        roughness: Input,
        diffuse_roughness: Input,
        ior: Input,
        alpha: Input,
        normal: Option<Input>,
        subsurface_weight: Input,
        specular_ior_level: Input,
        specular_tint: Input,
        anisotropic: Input,
        anisotropic_rotation: Input,
        tangent: Option<Input>,
        transmission_weight: Input,
        coat_weight: Input,
        coat_roughness: Input,
        coat_ior: Input,
        coat_tint: Input,
        coat_normal: Option<Input>,
        sheen_weight: Input,
        sheen_roughness: Input,
        sheen_tint: Input,
        emission_color: Input,
        emission_strength: Input,
        distribution: Distribution,
    },
    Diffuse {
        color: Input,
        roughness: Input,
        normal: Option<Input>,
    },
    /// The Diffuse BSDF of Blender 4.2, whose rough surfaces lose what is scattered more than once.
    SingleScatteringDiffuse {
        color: Input,
        roughness: Input,
        normal: Option<Input>,
    },
    Glossy {
        color: Input,
        roughness: Input,
        anisotropy: Input,
        rotation: Input,
        normal: Option<Input>,
        tangent: Option<Input>,
        distribution: Distribution,
    },
    Glass {
        color: Input,
        roughness: Input,
        ior: Input,
        normal: Option<Input>,
        distribution: Distribution,
    },
    Refraction {
        color: Input,
        roughness: Input,
        ior: Input,
        normal: Option<Input>,
        distribution: Distribution,
    },
    Translucent {
        color: Input,
        normal: Option<Input>,
    },
    Transparent {
        color: Input,
    },
    Emission {
        color: Input,
        strength: Input,
    },
    MixShader {
        factor: Input,
        a: Option<NodeId>,
        b: Option<NodeId>,
    },
    AddShader {
        a: Option<NodeId>,
        b: Option<NodeId>,
    },
    // Textures and coordinates.
    ImageTexture {
        texture: usize,
        vector: Option<Input>,
        interpolation: crate::Interpolation,
        extension: crate::Extension,
    },
    /// In JSON `{"type": "procedural", "texture": "noise", ...}`.
    Procedural(Procedural),
    TextureCoordinate {
        kind: TexCoord,
    },
    UvMap {
        name: String,
    },
    ColorAttribute {
        name: String,
    },
    Mapping {
        kind: MappingKind,
        vector: Input,
        location: Input,
        rotation: Input,
        scale: Input,
    },
    NormalMap {
        space: NormalSpace,
        uv_map: String,
        strength: Input,
        color: Input,
    },
    /// `filter_width` is the step of the finite differences in pixels: a socket in recent versions, 1 in Blender 4.2.
    Bump {
        invert: bool,
        strength: Input,
        distance: Input,
        #[serde(default = "default_filter_width")]
        filter_width: Input,
        height: Input,
        normal: Option<Input>,
    },
    // Colour and maths.
    Mix {
        data: MixData,
        blend: BlendMode,
        clamp_factor: bool,
        clamp_result: bool,
        factor: Input,
        a: Input,
        b: Input,
    },
    Math {
        operation: MathOp,
        clamp: bool,
        a: Input,
        b: Input,
        c: Input,
    },
    VectorMath {
        operation: VectorMathOp,
        a: Input,
        b: Input,
        c: Input,
        scale: Input,
    },
    MapRange {
        interpolation: MapRangeKind,
        clamp: bool,
        value: Input,
        from_min: Input,
        from_max: Input,
        to_min: Input,
        to_max: Input,
        steps: Input,
    },
    Clamp {
        range: bool,
        value: Input,
        min: Input,
        max: Input,
    },
    ColorRamp {
        factor: Input,
        ramp: Curve,
    },
    RgbCurves {
        factor: Input,
        color: Input,
        curves: Curve,
    },
    HueSaturation {
        hue: Input,
        saturation: Input,
        value: Input,
        factor: Input,
        color: Input,
    },
    BrightContrast {
        color: Input,
        bright: Input,
        contrast: Input,
    },
    Gamma {
        color: Input,
        gamma: Input,
    },
    Invert {
        factor: Input,
        color: Input,
    },
    /// RGB, HSV or HSL to x, y, z.
    SeparateColor {
        mode: ColorMode,
        color: Input,
    },
    CombineColor {
        mode: ColorMode,
        a: Input,
        b: Input,
        c: Input,
    },
    SeparateXyz {
        vector: Input,
    },
    CombineXyz {
        x: Input,
        y: Input,
        z: Input,
    },
    // Geometry.
    Fresnel {
        ior: Input,
        normal: Option<Input>,
    },
    LayerWeight {
        blend: Input,
        normal: Option<Input>,
    },
    Geometry,
    ObjectInfo,
}

fn default_filter_width() -> Input {
    Input::Float(1.0)
}

impl Node {
    /// Calls `visit` for every input socket.
    pub fn for_each_input(&mut self, mut visit: impl FnMut(&mut Input)) {
        let mut all = |inputs: &mut [&mut Input]| inputs.iter_mut().for_each(|input| visit(input));
        match self {
            Self::Principled {
                base_color,
                metallic,
                roughness,
                diffuse_roughness,
                ior,
                alpha,
                normal,
                subsurface_weight,
                specular_ior_level,
                specular_tint,
                anisotropic,
                anisotropic_rotation,
                tangent,
                transmission_weight,
                coat_weight,
                coat_roughness,
                coat_ior,
                coat_tint,
                coat_normal,
                sheen_weight,
                sheen_roughness,
                sheen_tint,
                emission_color,
                emission_strength,
                distribution: _,
            } => {
                all(&mut [base_color, metallic, roughness, diffuse_roughness, ior, alpha, subsurface_weight]);
                all(&mut [specular_ior_level, specular_tint, anisotropic, anisotropic_rotation]);
                all(&mut [transmission_weight, coat_weight, coat_roughness, coat_ior, coat_tint]);
                all(&mut [sheen_weight, sheen_roughness, sheen_tint, emission_color, emission_strength]);
                [normal, tangent, coat_normal].into_iter().flatten().for_each(visit);
            }
            Self::Diffuse { color, roughness, normal }
            | Self::SingleScatteringDiffuse { color, roughness, normal } => {
                all(&mut [color, roughness]);
                normal.iter_mut().for_each(visit);
            }
            Self::Glossy { color, roughness, anisotropy, rotation, normal, tangent, distribution: _ } => {
                all(&mut [color, roughness, anisotropy, rotation]);
                [normal, tangent].into_iter().flatten().for_each(visit);
            }
            Self::Glass { color, roughness, ior, normal, distribution: _ }
            | Self::Refraction { color, roughness, ior, normal, distribution: _ } => {
                all(&mut [color, roughness, ior]);
                normal.iter_mut().for_each(visit);
            }
            Self::Translucent { color, normal } => {
                all(&mut [color]);
                normal.iter_mut().for_each(visit);
            }
            Self::Transparent { color } => all(&mut [color]),
            Self::Emission { color, strength } => all(&mut [color, strength]),
            Self::MixShader { factor, a: _, b: _ } => all(&mut [factor]),
            Self::AddShader { .. }
            | Self::TextureCoordinate { .. }
            | Self::UvMap { .. }
            | Self::ColorAttribute { .. }
            | Self::Geometry
            | Self::ObjectInfo => {}
            Self::ImageTexture { vector, .. } => vector.iter_mut().for_each(visit),
            Self::Procedural(texture) => texture.for_each_input(visit),
            Self::Mapping { kind: _, vector, location, rotation, scale } => {
                all(&mut [vector, location, rotation, scale]);
            }
            Self::NormalMap { space: _, uv_map: _, strength, color } => all(&mut [strength, color]),
            Self::Bump { invert: _, strength, distance, filter_width, height, normal } => {
                all(&mut [strength, distance, filter_width, height]);
                normal.iter_mut().for_each(visit);
            }
            Self::Mix { factor, a, b, .. } => all(&mut [factor, a, b]),
            Self::Math { a, b, c, .. } => all(&mut [a, b, c]),
            Self::VectorMath { operation: _, a, b, c, scale } => all(&mut [a, b, c, scale]),
            Self::MapRange { value, from_min, from_max, to_min, to_max, steps, .. } => {
                all(&mut [value, from_min, from_max, to_min, to_max, steps]);
            }
            Self::Clamp { range: _, value, min, max } => all(&mut [value, min, max]),
            Self::ColorRamp { factor, ramp: _ } => all(&mut [factor]),
            Self::RgbCurves { factor, color, curves: _ } | Self::Invert { factor, color } => {
                all(&mut [factor, color]);
            }
            Self::HueSaturation { hue, saturation, value, factor, color } => {
                all(&mut [hue, saturation, value, factor, color]);
            }
            Self::BrightContrast { color, bright, contrast } => all(&mut [color, bright, contrast]),
            Self::Gamma { color, gamma } => all(&mut [color, gamma]),
            Self::SeparateColor { mode: _, color } => all(&mut [color]),
            Self::CombineColor { mode: _, a, b, c } => all(&mut [a, b, c]),
            Self::SeparateXyz { vector } => all(&mut [vector]),
            Self::CombineXyz { x, y, z } => all(&mut [x, y, z]),
            Self::Fresnel { ior, normal } | Self::LayerWeight { blend: ior, normal } => {
                all(&mut [ior]);
                normal.iter_mut().for_each(visit);
            }
        }
    }
}

/// Colour model of Separate and Combine Color.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "well-known names")]
pub enum ColorMode {
    Rgb,
    Hsv,
    Hsl,
}
