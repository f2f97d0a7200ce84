// Closed-form features of a light as seen from a pixel's first hit: the twin of `analytic.rs`, which tells what they are.

const FEATURES: u32 = 11u;
/// Kinds of lights: spheres and facing disks; rectangles.
const ROUND: u32 = 0u;
const QUAD: u32 = 1u;

/// What the features need of a pixel.
struct Surface {
    /// First hit, in units of the scene's scale.
    position: vec3f,
    /// Shading normal.
    normal: vec3f,
    /// Mirror direction of the camera's.
    mirror: vec3f,
}

/// A light in units of the scene's scale: centre, and radius (in `u.x`) or edges.
struct ScaledLight {
    center: vec3f,
    u: vec3f,
    v: vec3f,
}

struct Flux {
    area: f32,
    /// Vector irradiance per area of the light.
    vector: vec3f,
    extra: f32,
}

fn light_features(kind: u32, light: ScaledLight, at: Surface) -> array<f32, FEATURES> {
    let offset = light.center - at.position;
    var flux: Flux;
    if kind == QUAD {
        flux = quad_flux(light, offset);
    } else {
        flux = round_flux(light, offset);
    }
    let distance = sqrt(dot(offset, offset) + flux.area);
    let direction = offset / distance;
    let mirror = dot(at.mirror, direction);
    let lobe = max(mirror, 0.0);
    let lobe4 = lobe * lobe * lobe * lobe;
    let lobe16 = lobe4 * lobe4 * lobe4 * lobe4;
    let irradiance = max(dot(at.normal, flux.vector), 0.0);
    let root = sqrt(irradiance + 1e-3);
    return array<f32, FEATURES>(
        direction.x,
        direction.y,
        direction.z,
        1.0 / (1.0 + 4.0 * distance),
        dot(at.normal, direction),
        mirror,
        lobe4,
        lobe16,
        irradiance / (1.0 + irradiance),
        root / (1.0 + root),
        flux.extra,
    );
}

fn round_flux(light: ScaledLight, offset: vec3f) -> Flux {
    let radius = light.u.x;
    let squared = dot(offset, offset) + radius * radius;
    let distance = sqrt(squared);
    return Flux(radius * radius, offset / (squared * distance), radius / distance);
}

fn quad_flux(light: ScaledLight, offset: vec3f) -> Flux {
    let half_u = 0.5 * light.u;
    let half_v = 0.5 * light.v;
    let a = unit(offset - half_u - half_v);
    let b = unit(offset + half_u - half_v);
    let c = unit(offset + half_u + half_v);
    let d = unit(offset - half_u + half_v);
    let vector = edge_flux(a, b) + edge_flux(b, c) + edge_flux(c, d) + edge_flux(d, a);
    let normal = cross(half_u, half_v);
    let quarter = sqrt(dot(normal, normal) + 1e-16);
    let area = 4.0 * quarter;
    let distance = sqrt(dot(offset, offset) + area);
    return Flux(area, vector * (-0.5 / area), -dot(normal, offset) / (quarter * distance));
}

fn unit(v: vec3f) -> vec3f {
    return v / sqrt(dot(v, v) + 1e-8);
}

fn edge_flux(a: vec3f, b: vec3f) -> vec3f {
    return cross(a, b) * angle_over_sine(dot(a, b));
}

/// `acos(x) / sqrt(1 - x^2)`: a fit above 0, its supplement below.
fn angle_over_sine(x: f32) -> f32 {
    let magnitude = abs(x);
    let numerator = 1.5707937 + magnitude * (0.8966052 + magnitude * 0.025226796);
    let denominator = 1.0 + magnitude * (1.2073532 + magnitude * 0.2852716);
    let acute = numerator / denominator;
    if x >= 0.0 {
        return acute;
    }
    let sine = sqrt(max(1.0 - x * x, 0.0) + 1e-7);
    return 3.14159265 / sine - acute;
}
