//! Properties of shader nodes: choices, and tables baked from ramps and curves.

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

/// Reflectance of metals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MetalFresnel {
    /// Base Color seen head on, Edge Tint at the edge.
    F82,
    /// IOR and Extinction.
    PhysicalConductor,
}

/// Model of the Sheen BSDF.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SheenModel {
    /// Fibres that scatter many times.
    Microfiber,
    /// Velvet by Ashikhmin.
    Ashikhmin,
}

/// Component of the Toon BSDF.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToonComponent {
    /// About the normal.
    Diffuse,
    /// About the mirror direction.
    Glossy,
}

/// Colour of what a rough diffuse surface scatters more than once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MultipleScattering {
    /// Dimmed by the surface's colour once more than it is scattered, as in Blender before 5.3.
    #[default]
    Dimmed,
    /// Dimmed by the colour each time that it is scattered.
    Full,
}

impl MultipleScattering {
    pub(crate) fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Reading of an image's alpha.
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

/// Direction of a Tangent node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TangentKind {
    /// About the x axis of generated coordinates.
    X,
    /// About their y axis.
    Y,
    /// About their z axis.
    Z,
    /// Along u of a UV map.
    UvMap,
}

/// Operation of a Mapping node on its vector.
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

/// Surface on which a Bump node takes its heights, and a normal map its tangent space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceBase {
    /// The one that is shaded.
    #[default]
    Shaded,
    /// The one before displacement.
    Undisplaced,
    /// Places and tangents from before displacement, normals that are shaded, as in Blender before 5.0.
    UndisplacedPlaces,
}

impl SurfaceBase {
    /// True for the surface that is shaded.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
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

/// Operations of an Integer Math node (names of Blender's `operation`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum IntegerMathOp {
    Add,
    Subtract,
    Multiply,
    Divide,
    MultiplyAdd,
    Absolute,
    Negate,
    Power,
    Minimum,
    Maximum,
    Sign,
    DivideRound,
    DivideFloor,
    DivideCeil,
    FlooredModulo,
    Modulo,
    Gcd,
    Lcm,
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
    Wrap,
    Faceforward,
    Refract,
    Sign,
    Power,
    Round,
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

/// Fact about what the ray of a node meets. Distances are multiples of its direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RaycastOutput {
    /// 1 if it meets something, else 0.
    IsHit,
    /// 1 if it meets the object itself.
    SelfHit,
    /// Distance to it, or the ray's length.
    HitDistance,
    /// Position of it, or 0.
    HitPosition,
    /// Unit normal there on the side of the ray, or 0.
    HitNormal,
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

/// Colour model of Separate and Combine Color.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "well-known names")]
pub enum ColorMode {
    Rgb,
    Hsv,
    Hsl,
}
