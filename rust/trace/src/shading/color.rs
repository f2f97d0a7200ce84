//! Blender's colour nodes: blend modes, colour models, tables.

use glam::{Vec3, Vec4};
use relume_scene::{BlendMode, ColorMode, Curve};

/// Mean brightness of a scene-linear Rec.709 colour.
pub fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.212_672_9, 0.715_152_2, 0.072_175_0))
}

/// Hue, saturation and value of a colour, each 0..1 for colours in 0..1.
pub fn hsv_from_rgb(rgb: Vec3) -> Vec3 {
    let max = rgb.max_element();
    let delta = max - rgb.min_element();
    let saturation = if max == 0.0 { 0.0 } else { delta / max };
    if saturation == 0.0 {
        return Vec3::new(0.0, 0.0, max);
    }
    Vec3::new(hue(rgb, max, delta), saturation, max)
}

fn hue(rgb: Vec3, max: f32, delta: f32) -> f32 {
    let c = (Vec3::splat(max) - rgb) / delta;
    let sixths = if rgb.x == max {
        c.z - c.y
    } else if rgb.y == max {
        2.0 + c.x - c.z
    } else {
        4.0 + c.y - c.x
    };
    let hue = sixths / 6.0;
    if hue < 0.0 { hue + 1.0 } else { hue }
}

/// Inverse of [`hsv_from_rgb`]. As in Cycles a hue outside of 0..1 is not wrapped but lies in the last sixth.
pub fn rgb_from_hsv(hsv: Vec3) -> Vec3 {
    if hsv.y == 0.0 {
        return Vec3::splat(hsv.z);
    }
    let sixths = if hsv.x == 1.0 { 0.0 } else { hsv.x * 6.0 };
    let f = sixths - sixths.floor();
    let pure = match sixths.floor() {
        0.0 => Vec3::new(1.0, f, 0.0),
        1.0 => Vec3::new(1.0 - f, 1.0, 0.0),
        2.0 => Vec3::new(0.0, 1.0, f),
        3.0 => Vec3::new(0.0, 1.0 - f, 1.0),
        4.0 => Vec3::new(f, 0.0, 1.0),
        _ => Vec3::new(1.0, 0.0, 1.0 - f),
    };
    ((pure - 1.0) * hsv.y + 1.0) * hsv.z
}

/// Hue, saturation and lightness.
pub fn hsl_from_rgb(rgb: Vec3) -> Vec3 {
    let (max, min) = (rgb.max_element(), rgb.min_element());
    let lightness = ((max + min) * 0.5).min(1.0);
    let delta = max - min;
    if delta == 0.0 {
        return Vec3::new(0.0, 0.0, lightness);
    }
    let saturation = if lightness > 0.5 { delta / (2.0 - max - min) } else { delta / (max + min) };
    Vec3::new(hue(rgb, max, delta), saturation, lightness)
}

/// Inverse of [`hsl_from_rgb`]. As in Cycles a hue outside of 0..1 is red.
pub fn rgb_from_hsl(hsl: Vec3) -> Vec3 {
    let chroma = (1.0 - (2.0 * hsl.z - 1.0).abs()) * hsl.y;
    let sixths = hsl.x * 6.0;
    let pure = Vec3::new((sixths - 3.0).abs() - 1.0, 2.0 - (sixths - 2.0).abs(), 2.0 - (sixths - 4.0).abs())
        .clamp(Vec3::ZERO, Vec3::ONE);
    (pure - 0.5) * chroma + hsl.z
}

/// The parts of a colour in a colour model.
pub fn separate(mode: ColorMode, color: Vec3) -> Vec3 {
    match mode {
        ColorMode::Rgb => color,
        ColorMode::Hsv => hsv_from_rgb(color),
        ColorMode::Hsl => hsl_from_rgb(color),
    }
}

/// Inverse of [`separate`].
pub fn combine(mode: ColorMode, parts: Vec3) -> Vec3 {
    match mode {
        ColorMode::Rgb => parts,
        ColorMode::Hsv => rgb_from_hsv(parts),
        ColorMode::Hsl => rgb_from_hsl(parts),
    }
}

/// The Mix node's blend of `b` over `a` by `t`.
pub fn blend(mode: BlendMode, t: f32, a: Vec3, b: Vec3) -> Vec3 {
    let each = |f: fn(f32, f32, f32) -> f32| Vec3::new(f(t, a.x, b.x), f(t, a.y, b.y), f(t, a.z, b.z));
    match mode {
        BlendMode::Mix => a.lerp(b, t),
        BlendMode::Darken => a.lerp(a.min(b), t),
        BlendMode::Multiply => a.lerp(a * b, t),
        BlendMode::Burn => each(burn),
        BlendMode::Lighten => a.lerp(a.max(b), t),
        BlendMode::Screen => 1.0 - ((1.0 - t) + t * (1.0 - b)) * (1.0 - a),
        BlendMode::Dodge => each(dodge),
        BlendMode::Add => a.lerp(a + b, t),
        BlendMode::Overlay => each(overlay),
        BlendMode::SoftLight => {
            let screen = 1.0 - (1.0 - b) * (1.0 - a);
            a.lerp((1.0 - a) * b * a + a * screen, t)
        }
        BlendMode::LinearLight => a + t * (2.0 * b - 1.0),
        BlendMode::Difference => a.lerp((a - b).abs(), t),
        BlendMode::Exclusion => a.lerp(a + b - 2.0 * a * b, t).max(Vec3::ZERO),
        BlendMode::Subtract => a.lerp(a - b, t),
        BlendMode::Divide => each(|t, a, b| if b == 0.0 { a } else { (1.0 - t) * a + t * a / b }),
        BlendMode::Hue | BlendMode::Saturation | BlendMode::Color | BlendMode::Value => {
            blend_hsv(mode, t, a, b)
        }
    }
}

fn blend_hsv(mode: BlendMode, t: f32, a: Vec3, b: Vec3) -> Vec3 {
    let (hsv_a, hsv_b) = (hsv_from_rgb(a), hsv_from_rgb(b));
    match mode {
        BlendMode::Hue if hsv_b.y != 0.0 => a.lerp(rgb_from_hsv(hsv_a.with_x(hsv_b.x)), t),
        BlendMode::Saturation if hsv_a.y != 0.0 => {
            rgb_from_hsv(hsv_a.with_y(hsv_a.y + (hsv_b.y - hsv_a.y) * t))
        }
        BlendMode::Value => rgb_from_hsv(hsv_a.with_z(hsv_a.z + (hsv_b.z - hsv_a.z) * t)),
        BlendMode::Color if hsv_b.y != 0.0 => a.lerp(rgb_from_hsv(hsv_b.with_z(hsv_a.z)), t),
        _ => a,
    }
}

fn burn(t: f32, a: f32, b: f32) -> f32 {
    let denominator = 1.0 - t + t * b;
    if denominator <= 0.0 { 0.0 } else { (1.0 - (1.0 - a) / denominator).clamp(0.0, 1.0) }
}

fn dodge(t: f32, a: f32, b: f32) -> f32 {
    let denominator = 1.0 - t * b;
    if a == 0.0 {
        0.0
    } else if denominator <= 0.0 {
        1.0
    } else {
        (a / denominator).min(1.0)
    }
}

fn overlay(t: f32, a: f32, b: f32) -> f32 {
    if a < 0.5 { a * (1.0 - t + 2.0 * t * b) } else { 1.0 - (1.0 - t + 2.0 * t * (1.0 - b)) * (1.0 - a) }
}

/// The Hue/Saturation node.
pub fn hue_saturation(color: Vec3, hue: f32, saturation: f32, value: f32, factor: f32) -> Vec3 {
    let hsv = hsv_from_rgb(color);
    let turned = hsv.x + hue + 0.5;
    let shifted = Vec3::new(turned - turned.floor(), (hsv.y * saturation).clamp(0.0, 1.0), hsv.z * value);
    color.lerp(rgb_from_hsv(shifted), factor).max(Vec3::ZERO)
}

/// The Bright/Contrast node.
pub fn bright_contrast(color: Vec3, bright: f32, contrast: f32) -> Vec3 {
    (color * (1.0 + contrast) + (bright - contrast * 0.5)).max(Vec3::ZERO)
}

/// The Gamma node.
pub fn gamma(color: Vec3, gamma: f32) -> Vec3 {
    if gamma == 0.0 {
        return Vec3::ONE;
    }
    color.map(|c| if c > 0.0 { c.powf(gamma) } else { c })
}

/// An entry of a table at `x`.
pub fn lookup(curve: &Curve, x: f32) -> Vec4 {
    let entry = |i: usize| Vec4::from(curve.table[i]);
    let Some(last) = curve.table.len().checked_sub(1) else { return Vec4::ZERO };
    let position = (x - curve.min) / (curve.max - curve.min);
    if curve.extrapolate && last > 0 && !(0.0..=1.0).contains(&position) {
        let (end, slope, beyond) = if position < 0.0 {
            (entry(0), entry(0) - entry(1), -position)
        } else {
            (entry(last), entry(last) - entry(last - 1), position - 1.0)
        };
        return end + slope * (beyond * last as f32);
    }
    // A position that is not a number becomes the first entry.
    let place = position.clamp(0.0, 1.0) * last as f32;
    let index = (place as usize).min(last);
    let fraction = place - index as f32;
    if curve.interpolate && fraction > 0.0 {
        entry(index).lerp(entry((index + 1).min(last)), fraction)
    } else {
        entry(index)
    }
}

/// The RGB Curves node.
pub fn curves(curves: &Curve, factor: f32, color: Vec3) -> Vec3 {
    let curved = Vec3::new(lookup(curves, color.x).x, lookup(curves, color.y).y, lookup(curves, color.z).z);
    color.lerp(curved, factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: Vec3, b: Vec3) -> bool {
        (a - b).abs().max_element() < 1e-5
    }

    #[test]
    fn colour_models_come_back() {
        for color in [Vec3::new(0.2, 0.7, 0.4), Vec3::new(0.9, 0.1, 0.1), Vec3::new(0.3, 0.3, 0.8), Vec3::ONE]
        {
            for mode in [ColorMode::Rgb, ColorMode::Hsv, ColorMode::Hsl] {
                assert!(close(combine(mode, separate(mode, color)), color), "{mode:?} {color}");
            }
        }
    }

    #[test]
    fn hue_of_primaries() {
        assert_eq!(hsv_from_rgb(Vec3::X), Vec3::new(0.0, 1.0, 1.0));
        assert!(close(hsv_from_rgb(Vec3::Y), Vec3::new(1.0 / 3.0, 1.0, 1.0)));
        assert!(close(hsv_from_rgb(Vec3::Z), Vec3::new(2.0 / 3.0, 1.0, 1.0)));
    }

    #[test]
    fn factor_zero_keeps_the_first_colour() {
        use BlendMode::*;
        let (a, b) = (Vec3::new(0.2, 0.6, 0.9), Vec3::new(0.7, 0.1, 0.4));
        for mode in [
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
        ] {
            assert!(close(blend(mode, 0.0, a, b), a), "{mode:?}");
        }
    }

    #[test]
    fn tables_extrapolate_only_on_request() {
        let mut curve = Curve {
            min: 0.0,
            max: 2.0,
            table: vec![[0.0; 4], [1.0; 4], [4.0; 4]],
            interpolate: true,
            extrapolate: false,
        };
        assert_eq!(lookup(&curve, 1.5).x, 2.5);
        assert_eq!(lookup(&curve, 9.0).x, 4.0);
        assert_eq!(lookup(&curve, f32::NAN).x, 0.0);
        curve.extrapolate = true;
        assert_eq!(lookup(&curve, 3.0).x, 7.0);
        assert_eq!(lookup(&curve, -1.0).x, -1.0);
        curve.interpolate = false;
        assert_eq!(lookup(&curve, 1.9).x, 1.0);
    }
}
