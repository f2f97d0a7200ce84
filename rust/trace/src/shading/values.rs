//! Values of nodes that depend on nothing but their inputs, and how inputs are read.

use glam::{Vec3, Vec4};
use relume_scene::{Input, MapRangeKind, MixData, Node, NodeId, Output};

use super::{color, math};

/// A node's outputs in four numbers: colour or vector in xyz and alpha in w. A float is in every component, Layer
/// Weight has its Fresnel and facing outputs in x and y, a procedural texture its number in w.
pub trait NodeInputs {
    /// The four numbers of a linked node. Outputs that are read from the geometry have them in place of the node's.
    fn link(&self, node: NodeId, output: Output) -> Vec4;

    /// An input read as a float, with Blender's conversions.
    fn float(&self, input: &Input) -> f32 {
        match input {
            Input::Float(value) => *value,
            Input::Rgb(rgb) => color::luminance(Vec3::from(*rgb)),
            Input::Link { node, output } => {
                let value = self.link(*node, *output);
                component(value, *output).unwrap_or_else(|| match output {
                    Output::Color => color::luminance(value.truncate()),
                    _ => value.truncate().element_sum() / 3.0,
                })
            }
        }
    }

    /// An input read as a colour or vector.
    fn vector(&self, input: &Input) -> Vec3 {
        match input {
            Input::Float(value) => Vec3::splat(*value),
            Input::Rgb(rgb) => Vec3::from(*rgb),
            Input::Link { node, output } => {
                let value = self.link(*node, *output);
                component(value, *output).map_or(value.truncate(), Vec3::splat)
            }
        }
    }
}

/// The float that an output is; nothing if it is a colour or a vector.
pub fn component(value: Vec4, output: Output) -> Option<f32> {
    match output {
        Output::Value
        | Output::Fresnel
        | Output::X
        | Output::Backfacing
        | Output::ObjectIndex
        | Output::Random
        | Output::IsStrand
        | Output::Intercept
        | Output::Length
        | Output::Thickness
        | Output::StrandRandom
        | Output::PointRadius
        | Output::PointRandom
        | Output::IsCameraRay
        | Output::IsShadowRay
        | Output::IsDiffuseRay
        | Output::IsGlossyRay
        | Output::IsSingularRay
        | Output::IsReflectionRay
        | Output::IsTransmissionRay
        | Output::IsVolumeScatterRay
        | Output::RayLength
        | Output::RayDepth
        | Output::DiffuseDepth
        | Output::GlossyDepth
        | Output::TransparentDepth
        | Output::PortalDepth
        | Output::TransmissionDepth => Some(value.x),
        Output::Facing | Output::Y => Some(value.y),
        Output::Z => Some(value.z),
        Output::Alpha | Output::W | Output::Factor | Output::Distance | Output::Radius => Some(value.w),
        Output::Color
        | Output::Vector
        | Output::Normal
        | Output::Position
        | Output::TrueNormal
        | Output::Parametric
        | Output::Incoming
        | Output::Tangent
        | Output::TangentNormal
        | Output::PointPosition
        | Output::Location => None,
    }
}

fn clamp_if(condition: bool, value: Vec3) -> Vec3 {
    if condition { value.clamp(Vec3::ZERO, Vec3::ONE) } else { value }
}

/// The value of a node that depends on its inputs alone; nothing for other nodes and for closures.
pub fn evaluate_pure(node: &Node, inputs: &impl NodeInputs) -> Option<Vec4> {
    let float = |input| inputs.float(input);
    let vector = |input| inputs.vector(input);
    let saturated = |value: f32| Vec4::splat(value.clamp(0.0, 1.0));
    let value = match node {
        Node::Mix { data, blend, clamp_factor, clamp_result, factor, a, b } => match data {
            MixData::VectorNonUniform => {
                let t = clamp_if(*clamp_factor, vector(factor));
                (vector(a) * (1.0 - t) + vector(b) * t).extend(1.0)
            }
            _ => {
                let t = float(factor);
                let t = if *clamp_factor { t.clamp(0.0, 1.0) } else { t };
                match data {
                    MixData::Float => Vec4::splat(float(a) * (1.0 - t) + float(b) * t),
                    MixData::Color => {
                        clamp_if(*clamp_result, color::blend(*blend, t, vector(a), vector(b))).extend(1.0)
                    }
                    _ => vector(a).lerp(vector(b), t).extend(1.0),
                }
            }
        },
        Node::Math { operation, clamp, a, b, c } => {
            let value = math::math(*operation, float(a), float(b), float(c));
            if *clamp { saturated(value) } else { Vec4::splat(value) }
        }
        Node::IntegerMath { operation, a, b, c } => {
            let [a, b, c] = [a, b, c].map(|input| float(input) as i32);
            Vec4::splat(math::integer_math(*operation, a, b, c) as f32)
        }
        Node::VectorMath { operation, a, b, c, scale } => {
            let value = math::vector_math(*operation, vector(a), vector(b), vector(c), float(scale));
            value.extend(value.x)
        }
        Node::MapRange {
            interpolation,
            clamp,
            empty_gives_min,
            value,
            from_min,
            from_max,
            to_min,
            to_max,
            steps,
        } => {
            let (from, to) = ([float(from_min), float(from_max)], [float(to_min), float(to_max)]);
            let mapped = map_range(*interpolation, float(value), from, to, float(steps), *empty_gives_min);
            Vec4::splat(if *clamp { mapped.clamp(to[0].min(to[1]), to[0].max(to[1])) } else { mapped })
        }
        Node::Clamp { range, value, min, max } => {
            let (min, max) = (float(min), float(max));
            let (min, max) = if *range { (min.min(max), min.max(max)) } else { (min, max) };
            Vec4::splat(float(value).max(min).min(max))
        }
        Node::ColorRamp { factor, ramp } => color::lookup(ramp, float(factor)),
        Node::RgbCurves { factor, color, curves } => {
            color::curves(curves, float(factor), vector(color)).extend(1.0)
        }
        Node::HueSaturation { hue, saturation, value, factor, color } => {
            color::hue_saturation(vector(color), float(hue), float(saturation), float(value), float(factor))
                .extend(1.0)
        }
        Node::BrightContrast { color, bright, contrast } => {
            color::bright_contrast(vector(color), float(bright), float(contrast)).extend(1.0)
        }
        Node::Gamma { color, gamma } => color::gamma(vector(color), float(gamma)).extend(1.0),
        Node::Invert { factor, color } => {
            let color = vector(color);
            color.lerp(1.0 - color, float(factor)).extend(1.0)
        }
        Node::SeparateColor { mode, color } => color::separate(*mode, vector(color)).extend(1.0),
        Node::CombineColor { mode, a, b, c } => {
            color::combine(*mode, Vec3::new(float(a), float(b), float(c))).extend(1.0)
        }
        Node::SeparateXyz { vector: v } => vector(v).extend(1.0),
        Node::CombineXyz { x, y, z } => Vec4::new(float(x), float(y), float(z), 1.0),
        _ => return None,
    };
    Some(value)
}

/// A Map Range node before its clamp. A range of no width gives 0, as before Blender 5.0, or the start of the other range.
fn map_range(
    kind: MapRangeKind,
    value: f32,
    from: [f32; 2],
    to: [f32; 2],
    steps: f32,
    empty_gives_min: bool,
) -> f32 {
    match from[0] == from[1] {
        false => math::map_range(kind, value, from, to, steps),
        true if empty_gives_min => to[0],
        true => 0.0,
    }
}
