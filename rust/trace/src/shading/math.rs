//! Blender's Math, Vector Math and Map Range nodes, with their safe variants of what is undefined.

use glam::Vec3;
use relume_scene::{IntegerMathOp, MapRangeKind, MathOp, VectorMathOp};

/// `a / b`, and 0 where `b` is 0.
pub fn safe_divide(a: f32, b: f32) -> f32 {
    if b == 0.0 { 0.0 } else { a / b }
}

/// Component by component [`safe_divide`].
pub fn safe_divide_vector(a: Vec3, b: Vec3) -> Vec3 {
    Vec3::new(safe_divide(a.x, b.x), safe_divide(a.y, b.y), safe_divide(a.z, b.z))
}

fn safe_power(a: f32, b: f32) -> f32 {
    if a < 0.0 && b != b.trunc() { 0.0 } else { a.powf(b) }
}

fn safe_logarithm(a: f32, base: f32) -> f32 {
    if a <= 0.0 || base <= 0.0 { 0.0 } else { safe_divide(a.ln(), base.ln()) }
}

fn safe_modulo(a: f32, b: f32) -> f32 {
    if b == 0.0 { 0.0 } else { a % b }
}

fn wrap(value: f32, max: f32, min: f32) -> f32 {
    let range = max - min;
    if range == 0.0 { min } else { value - range * ((value - min) / range).floor() }
}

fn pingpong(value: f32, scale: f32) -> f32 {
    if scale == 0.0 {
        return 0.0;
    }
    let x = (value - scale) / (scale * 2.0);
    ((x - x.floor()) * scale * 2.0 - scale).abs()
}

fn smooth_minimum(a: f32, b: f32, distance: f32) -> f32 {
    if distance == 0.0 {
        return a.min(b);
    }
    let h = (distance - (a - b).abs()).max(0.0) / distance;
    a.min(b) - h * h * h * distance / 6.0
}

/// Direction of a ray of unit length behind a surface, with `eta` the ratio of refractive indices before and behind; 0 where
/// all of it is reflected.
fn refract(incident: Vec3, normal: Vec3, eta: f32) -> Vec3 {
    let cos = normal.dot(incident);
    let squared = 1.0 - eta * eta * (1.0 - cos * cos);
    if squared < 0.0 { Vec3::ZERO } else { incident * eta - normal * (eta * cos + squared.sqrt()) }
}

/// The Math node.
pub fn math(operation: MathOp, a: f32, b: f32, c: f32) -> f32 {
    match operation {
        MathOp::Add => a + b,
        MathOp::Subtract => a - b,
        MathOp::Multiply => a * b,
        MathOp::Divide => safe_divide(a, b),
        MathOp::MultiplyAdd => a * b + c,
        MathOp::Power => safe_power(a, b),
        MathOp::Logarithm => safe_logarithm(a, b),
        MathOp::Sqrt => a.max(0.0).sqrt(),
        MathOp::InverseSqrt => {
            if a > 0.0 {
                1.0 / a.sqrt()
            } else {
                0.0
            }
        }
        MathOp::Absolute => a.abs(),
        MathOp::Exponent => a.exp(),
        MathOp::Minimum => a.min(b),
        MathOp::Maximum => a.max(b),
        MathOp::LessThan => f32::from(a < b),
        MathOp::GreaterThan => f32::from(a > b),
        MathOp::Sign => {
            if a == 0.0 {
                0.0
            } else {
                1.0f32.copysign(a)
            }
        }
        MathOp::Compare => f32::from(a == b || (a - b).abs() <= c.max(f32::EPSILON)),
        MathOp::SmoothMin => smooth_minimum(a, b, c),
        MathOp::SmoothMax => -smooth_minimum(-a, -b, c),
        MathOp::Round => (a + 0.5).floor(),
        MathOp::Floor => a.floor(),
        MathOp::Ceil => a.ceil(),
        MathOp::Trunc => a.trunc(),
        MathOp::Fract => a - a.floor(),
        MathOp::Modulo => safe_modulo(a, b),
        MathOp::FlooredModulo => {
            if b == 0.0 {
                0.0
            } else {
                a - (a / b).floor() * b
            }
        }
        MathOp::Wrap => wrap(a, b, c),
        MathOp::Snap => safe_divide(a, b).floor() * b,
        MathOp::Pingpong => pingpong(a, b),
        MathOp::Sine => a.sin(),
        MathOp::Cosine => a.cos(),
        MathOp::Tangent => a.tan(),
        MathOp::Arcsine => a.clamp(-1.0, 1.0).asin(),
        MathOp::Arccosine => a.clamp(-1.0, 1.0).acos(),
        MathOp::Arctangent => a.atan(),
        MathOp::Arctan2 => a.atan2(b),
        MathOp::Sinh => a.sinh(),
        MathOp::Cosh => a.cosh(),
        MathOp::Tanh => a.tanh(),
        MathOp::Radians => a.to_radians(),
        MathOp::Degrees => a.to_degrees(),
    }
}

/// The Integer Math node; results beyond 32 bits start anew at the other end.
pub fn integer_math(operation: IntegerMathOp, a: i32, b: i32, c: i32) -> i32 {
    let is_divided = b != 0;
    let floored = |a: i32, b: i32| {
        let quotient = a.wrapping_div(b);
        quotient - i32::from(a.wrapping_rem(b) != 0 && (a < 0) != (b < 0))
    };
    match operation {
        IntegerMathOp::Add => a.wrapping_add(b),
        IntegerMathOp::Subtract => a.wrapping_sub(b),
        IntegerMathOp::Multiply => a.wrapping_mul(b),
        IntegerMathOp::MultiplyAdd => a.wrapping_mul(b).wrapping_add(c),
        IntegerMathOp::Absolute => a.wrapping_abs(),
        IntegerMathOp::Negate => a.wrapping_neg(),
        IntegerMathOp::Power if b >= 0 => a.wrapping_pow(b as u32),
        IntegerMathOp::Power => match a {
            1 => 1,
            -1 => 1 - 2 * (b & 1),
            _ => 0,
        },
        IntegerMathOp::Minimum => a.min(b),
        IntegerMathOp::Maximum => a.max(b),
        IntegerMathOp::Sign => a.signum(),
        IntegerMathOp::Divide if is_divided => a.wrapping_div(b),
        IntegerMathOp::DivideRound if is_divided => {
            let (a, b) = (i64::from(a), i64::from(b));
            ((2 * a.abs() + b.abs()) / (2 * b.abs()) * a.signum() * b.signum()) as i32
        }
        IntegerMathOp::DivideFloor if is_divided => floored(a, b),
        IntegerMathOp::DivideCeil if is_divided => floored(a, b.wrapping_neg()).wrapping_neg(),
        IntegerMathOp::FlooredModulo if is_divided => a.wrapping_rem(b).wrapping_add(b).wrapping_rem(b),
        IntegerMathOp::Modulo if is_divided => a.wrapping_rem(b),
        IntegerMathOp::Gcd => divisor(a, b),
        IntegerMathOp::Lcm => match divisor(a, b) {
            0 => 0,
            divisor => (a / divisor).wrapping_mul(b).wrapping_abs(),
        },
        _ => 0,
    }
}

/// Greatest common divisor; 0 of two zeros.
fn divisor(a: i32, b: i32) -> i32 {
    let (mut a, mut b) = (a.wrapping_abs(), b.wrapping_abs());
    while b != 0 {
        (a, b) = (b, a.wrapping_rem(b));
    }
    a
}

/// The Vector Math node; results that are numbers are in every component.
pub fn vector_math(operation: VectorMathOp, a: Vec3, b: Vec3, c: Vec3, scale: f32) -> Vec3 {
    match operation {
        VectorMathOp::Add => a + b,
        VectorMathOp::Subtract => a - b,
        VectorMathOp::Multiply => a * b,
        VectorMathOp::Divide => safe_divide_vector(a, b),
        VectorMathOp::MultiplyAdd => a * b + c,
        VectorMathOp::CrossProduct => a.cross(b),
        VectorMathOp::Project => b * safe_divide(a.dot(b), b.dot(b)),
        VectorMathOp::Reflect => {
            let normal = b.normalize_or_zero();
            a - normal * (2.0 * a.dot(normal))
        }
        VectorMathOp::DotProduct => Vec3::splat(a.dot(b)),
        VectorMathOp::Distance => Vec3::splat(a.distance(b)),
        VectorMathOp::Length => Vec3::splat(a.length()),
        VectorMathOp::Scale => a * scale,
        VectorMathOp::Normalize => a.normalize_or_zero(),
        VectorMathOp::Absolute => a.abs(),
        VectorMathOp::Minimum => a.min(b),
        VectorMathOp::Maximum => a.max(b),
        VectorMathOp::Floor => a.floor(),
        VectorMathOp::Ceil => a.ceil(),
        VectorMathOp::Fraction => a - a.floor(),
        VectorMathOp::Modulo => {
            Vec3::new(safe_modulo(a.x, b.x), safe_modulo(a.y, b.y), safe_modulo(a.z, b.z))
        }
        VectorMathOp::Snap => safe_divide_vector(a, b).floor() * b,
        VectorMathOp::Sine => a.map(f32::sin),
        VectorMathOp::Cosine => a.map(f32::cos),
        VectorMathOp::Tangent => a.map(f32::tan),
        VectorMathOp::Wrap => Vec3::new(wrap(a.x, b.x, c.x), wrap(a.y, b.y, c.y), wrap(a.z, b.z, c.z)),
        VectorMathOp::Faceforward => {
            if c.dot(b) < 0.0 {
                a
            } else {
                -a
            }
        }
        VectorMathOp::Refract => refract(a, b.normalize_or_zero(), scale),
        VectorMathOp::Sign => {
            Vec3::select(a.cmpgt(Vec3::ZERO), Vec3::ONE, Vec3::ZERO)
                - Vec3::select(a.cmplt(Vec3::ZERO), Vec3::ONE, Vec3::ZERO)
        }
        VectorMathOp::Power => Vec3::new(safe_power(a.x, b.x), safe_power(a.y, b.y), safe_power(a.z, b.z)),
        VectorMathOp::Round => (a + 0.5).floor(),
    }
}

/// The Map Range node for floats, not clamped; `from` is a range of some width.
pub fn map_range(kind: MapRangeKind, value: f32, from: [f32; 2], to: [f32; 2], steps: f32) -> f32 {
    let linear = (value - from[0]) / (from[1] - from[0]);
    let x = linear.clamp(0.0, 1.0);
    let factor = match kind {
        MapRangeKind::Linear => linear,
        MapRangeKind::Stepped if steps > 0.0 => (linear * (steps + 1.0)).floor() / steps,
        MapRangeKind::Stepped => 0.0,
        MapRangeKind::Smoothstep => x * x * (3.0 - 2.0 * x),
        MapRangeKind::Smootherstep => x * x * x * (x * (x * 6.0 - 15.0) + 10.0),
    };
    to[0] + factor * (to[1] - to[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn undefined_operations_give_zero() {
        assert_eq!(math(MathOp::Divide, 1.0, 0.0, 0.0), 0.0);
        assert_eq!(math(MathOp::Power, -2.0, 0.5, 0.0), 0.0);
        assert_eq!(math(MathOp::Power, -2.0, 3.0, 0.0), -8.0);
        assert_eq!(math(MathOp::Logarithm, -1.0, 2.0, 0.0), 0.0);
        assert_eq!(math(MathOp::Logarithm, 8.0, 1.0, 0.0), 0.0);
        assert_eq!(math(MathOp::Sqrt, -4.0, 0.0, 0.0), 0.0);
        assert_eq!(math(MathOp::Modulo, 3.0, 0.0, 0.0), 0.0);
        assert_eq!(vector_math(VectorMathOp::Divide, Vec3::ONE, Vec3::X, Vec3::ZERO, 0.0), Vec3::X);
        assert_eq!(vector_math(VectorMathOp::Project, Vec3::ONE, Vec3::ZERO, Vec3::ZERO, 0.0), Vec3::ZERO);
    }

    #[test]
    fn whole_numbers_are_divided_as_in_blender() {
        use IntegerMathOp::{DivideCeil, DivideFloor, DivideRound, FlooredModulo, Gcd, Lcm, Modulo, Power};
        let of = |operation, a, b| integer_math(operation, a, b, 0);
        assert_eq!([of(DivideFloor, -7, 2), of(DivideCeil, -7, 2), of(DivideRound, -7, 2)], [-4, -3, -4]);
        assert_eq!([of(DivideFloor, 7, 2), of(DivideCeil, 7, 2), of(DivideRound, 5, 3)], [3, 4, 2]);
        assert_eq!([of(Modulo, -7, 3), of(FlooredModulo, -7, 3), of(Modulo, 5, 0)], [-1, 2, 0]);
        assert_eq!([of(Gcd, -12, 18), of(Lcm, 4, -6), of(Lcm, 0, 0)], [6, 12, 0]);
        assert_eq!([of(Power, -2, 3), of(Power, -1, -3), of(Power, 3, -1)], [-8, -1, 0]);
    }

    #[test]
    fn periodic_operations_follow_blender() {
        assert_eq!(math(MathOp::Modulo, -3.5, 2.0, 0.0), -1.5);
        assert_eq!(math(MathOp::FlooredModulo, -3.5, 2.0, 0.0), 0.5);
        assert!((math(MathOp::Wrap, 2.6, 1.0, -1.0) - 0.6).abs() < 1e-6);
        assert!((math(MathOp::Pingpong, 2.7, 1.0, 0.0) - 0.7).abs() < 1e-6);
        assert_eq!(math(MathOp::Snap, 2.7, 0.5, 0.0), 2.5);
        assert_eq!(math(MathOp::Round, -0.5, 0.0, 0.0), 0.0);
    }

    #[test]
    fn map_range_follows_reversed_ranges_and_steps() {
        let reversed = |kind| map_range(kind, 3.0, [0.0, 1.0], [5.0, 2.0], 4.0);
        assert_eq!(reversed(MapRangeKind::Linear), -4.0);
        assert_eq!(reversed(MapRangeKind::Smoothstep), 2.0);
        assert_eq!(map_range(MapRangeKind::Stepped, 0.5, [0.0, 1.0], [0.0, 1.0], 4.0), 0.5);
    }
}
