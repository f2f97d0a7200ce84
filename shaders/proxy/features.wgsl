// Closed-form features of a light at a surface: `features` of `analytic.rs`, in dual numbers (value, derivative), so that
// the derivative by any parameter needs no second set of formulas. Where it is not asked for, the compiler drops it.
// constant: FORM 0

// The numbers of `Form` in `light.rs`.
const ROUND: u32 = 0u;
const FLAT: u32 = 1u;
const CONE: u32 = 2u;
const FEATURES: u32 = 11u;
// As in `analytic.rs`.
const LEAST_EDGE: f32 = 0.05;

// What the features need of a pixel, as `PixelSurface` of `analytic.rs`.
struct Surface { position: vec3f, normal: vec3f, mirror: vec3f }

// A vector and its derivative.
struct Dual3 { value: vec3f, d: vec3f }

// A light as `seen_params` of `analytic.rs` has it: centre; then of flat lights the two edges, else the radius, of spots also the
// cosine of the half angle and the blend; then their axis.
struct FeatureLight { center: Dual3, u: Dual3, v: Dual3 }

// Area or squared radius, vector irradiance per area, the share of the light that comes here, and the last feature.
struct Source { area: vec2f, flux: Dual3, share: vec2f, extra: vec2f }

fn constant(x: f32) -> vec2f { return vec2f(x, 0.0); }

fn times(a: vec2f, b: vec2f) -> vec2f { return vec2f(a.x * b.x, a.x * b.y + a.y * b.x); }

fn over(a: vec2f, b: vec2f) -> vec2f {
    let quotient = a.x / b.x;
    return vec2f(quotient, (a.y - quotient * b.y) / b.x);
}

fn root(a: vec2f) -> vec2f {
    let value = sqrt(a.x);
    return vec2f(value, select(0.0, 0.5 * a.y / value, value > 0.0));
}

fn ramp(a: vec2f) -> vec2f { return select(vec2f(), a, a.x > 0.0); }

fn plus(a: Dual3, b: Dual3) -> Dual3 { return Dual3(a.value + b.value, a.d + b.d); }

fn minus(a: Dual3, b: Dual3) -> Dual3 { return Dual3(a.value - b.value, a.d - b.d); }

fn scaled(a: Dual3, s: vec2f) -> Dual3 { return Dual3(a.value * s.x, a.value * s.y + a.d * s.x); }

fn dots(a: Dual3, b: Dual3) -> vec2f {
    return vec2f(dot(a.value, b.value), dot(a.value, b.d) + dot(a.d, b.value));
}

fn crosses(a: Dual3, b: Dual3) -> Dual3 {
    return Dual3(cross(a.value, b.value), cross(a.value, b.d) + cross(a.d, b.value));
}

fn still(a: vec3f) -> Dual3 { return Dual3(a, vec3f()); }

// A light, with the derivative by its parameter of this number (9 or more: by none).
fn feature_light(center: vec3f, u: vec3f, v: vec3f, parameter: u32) -> FeatureLight {
    return FeatureLight(
        Dual3(center, unit_vector(parameter)),
        Dual3(u, unit_vector(parameter - 3u)),
        Dual3(v, unit_vector(parameter - 6u)),
    );
}

// All zeros unless the axis is 0, 1 or 2.
fn unit_vector(axis: u32) -> vec3f { return select(vec3f(), vec3f(1.0), vec3u(axis) == vec3u(0u, 1u, 2u)); }

fn features(light: FeatureLight, at: Surface) -> array<vec2f, FEATURES> {
    let one = constant(1.0);
    let offset = minus(light.center, still(at.position));
    var source: Source;
    if FORM == FLAT {
        source = flat_source(light, offset);
    } else if FORM == CONE {
        source = cone_source(light, offset);
    } else {
        source = round_source(light, offset);
    }
    let distance = root(dots(offset, offset) + source.area);
    let direction = scaled(offset, over(one, distance));
    let mirror = dots(still(at.mirror), direction);
    let lobe2 = times(ramp(mirror), ramp(mirror));
    let lobe4 = times(lobe2, lobe2);
    let lobe8 = times(lobe4, lobe4);
    let irradiance = ramp(dots(still(at.normal), source.flux));
    // The constant bounds the slope at the horizon.
    let soft = root(irradiance + constant(1e-3));
    return array<vec2f, FEATURES>(
        vec2f(direction.value.x, direction.d.x),
        vec2f(direction.value.y, direction.d.y),
        vec2f(direction.value.z, direction.d.z),
        over(one, one + 4.0 * distance),
        dots(still(at.normal), direction),
        mirror,
        times(lobe4, source.share),
        times(times(lobe8, lobe8), source.share),
        over(irradiance, one + irradiance),
        over(soft, one + soft),
        source.extra,
    );
}

// A small source: `L / |L|^3`.
fn round_source(light: FeatureLight, offset: Dual3) -> Source {
    let radius = vec2f(light.u.value.x, light.u.d.x);
    let area = times(radius, radius);
    let squared = dots(offset, offset) + area;
    let distance = root(squared);
    let flux = scaled(offset, over(constant(1.0), times(squared, distance)));
    return Source(area, flux, constant(1.0), over(radius, distance));
}

// A small source in a cone with a soft edge.
fn cone_source(light: FeatureLight, offset: Dual3) -> Source {
    let one = constant(1.0);
    let source = round_source(light, offset);
    let edge = vec2f(light.u.value.y, light.u.d.y);
    let blend = vec2f(light.u.value.z, light.u.d.z);
    let distance = root(dots(offset, offset) + source.area);
    let cosine = -over(dots(light.v, offset), distance);
    let depth = one - edge;
    let soft = times(root(ramp(one - times(edge, edge))), source.extra) + LEAST_EDGE * depth;
    let inside = ramp(over(cosine - edge + soft, times(depth, blend) + 2.0 * soft));
    let x = one - ramp(one - inside);
    let share = times(times(x, x), constant(3.0) - 2.0 * x);
    return Source(source.area, scaled(source.flux, share), share, share);
}

// A Lambertian rectangle, by Lambert's polygon formula.
fn flat_source(light: FeatureLight, offset: Dual3) -> Source {
    let u = scaled(light.u, constant(0.5));
    let v = scaled(light.v, constant(0.5));
    let a = toward(minus(minus(offset, u), v));
    let b = toward(minus(plus(offset, u), v));
    let c = toward(plus(plus(offset, u), v));
    let d = toward(plus(minus(offset, u), v));
    let flux = plus(plus(edge(a, b), edge(b, c)), plus(edge(c, d), edge(d, a)));
    let normal = crosses(u, v);
    let quarter = root(dots(normal, normal) + constant(1e-16));
    let area = 4.0 * quarter;
    let distance = root(dots(offset, offset) + area);
    let cosine = -over(dots(normal, offset), times(quarter, distance));
    return Source(area, scaled(flux, over(constant(-0.5), area)), constant(1.0), cosine);
}

fn toward(corner: Dual3) -> Dual3 {
    return scaled(corner, over(constant(1.0), root(dots(corner, corner) + constant(1e-8))));
}

fn edge(a: Dual3, b: Dual3) -> Dual3 { return scaled(crosses(a, b), angle_over_sine(dots(a, b))); }

// `acos(x) / sqrt(1 - x^2)`: a rational fit above 0, the supplementary angle below. The numbers are those of `ANGLE_FIT`.
fn angle_over_sine(x: vec2f) -> vec2f {
    let magnitude = ramp(x) + ramp(-x);
    let numerator = constant(1.5707937) + times(magnitude, constant(0.8966052) + 0.025226796 * magnitude);
    let denominator = constant(1.0) + times(magnitude, constant(1.2073532) + 0.2852716 * magnitude);
    let acute = over(numerator, denominator);
    let negative = over(ramp(-x), magnitude + constant(1e-20));
    let sine = root(ramp(constant(1.0) - times(x, x)) + constant(1e-7));
    return acute + times(negative, over(constant(3.14159265), sine) - 2.0 * acute);
}
