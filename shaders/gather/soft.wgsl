// A smoothed light and its derivatives by the lanes of its shape: the formulas of `rust/gather/src/soft`, described there and
// in `docs/solve.md`.
// use: gather/light

// How a length enlarges (`Enlarged`).
struct Enlarged {
    inverse: f32,
    share: f32,
    edge: f32,
    // 0 where the size only scales, else 1.
    is_free: f32,
}

// Derivatives of a cone's middle, share and edge.
struct ConeSlope {
    middle: f32,
    share: f32,
    edge: f32,
}

struct SoftLight {
    center: vec3f,
    kind: u32,
    // Axis of a spot, normal of an area, towards a sun.
    direction: vec3f,
    // Of the smoothing, metres.
    width: f32,
    // Directions of the edges of an area.
    along_u: vec3f,
    // Of a ball.
    radius: f32,
    along_v: vec3f,
    // Cosine up to which the front of an area fades in.
    fade: f32,
    // Radius or chord; half edges of an area.
    half: array<Enlarged, 2>,
    // Of a cone.
    inverse_middle: f32,
    share: f32,
    edge: f32,
    by_angle: ConeSlope,
    by_blend: ConeSlope,
    // Of the spread of an area; a normalisation of 0 is that of a Lambertian emitter.
    tan_half: f32,
    normalisation: f32,
    knee: f32,
    // Of a sun.
    chord2_by_angle: f32,
    // Squared radius of a ball around `center` that holds all that the light touches.
    reach2: f32,
}

// Value, then derivatives by the lanes.
const OUTPUTS = 11u;
// Smallest cosine that is divided by.
const GRAZING = 1e-4;

@group(0) @binding(8) var<storage, read> soft: SoftLight;

// Of the segment that was looked at last.
var<private> outputs: array<f32, OUTPUTS>;

// A piece of a ray: where the ray begins and goes, and how far along it the piece starts and ends.
struct Ray {
    origin: vec3f,
    direction: vec3f,
    start: f32,
    end: f32,
}

// Fills `outputs`.
fn evaluate(ray: Ray) {
    outputs = array<f32, OUTPUTS>();
    switch soft.kind {
        case SPHERE: { put_round(sphere(ray, 1.0), ray); }
        case FACING_DISK: { put_round(facing_disk(ray), ray); }
        case SPOT, SOFT_SPOT: { put_spot(ray); }
        case QUAD, ELLIPSE: { put_area(ray); }
        default: { put_sun(ray); }
    }
}

fn put(first: u32, vector: vec3f) {
    outputs[first] = vector.x;
    outputs[first + 1u] = vector.y;
    outputs[first + 2u] = vector.z;
}

// A cubic step from 0 to 1 as `k` goes from 0 to 1, and its derivative.
fn cubic(k: f32) -> vec2f {
    let inside = clamp(k, 0.0, 1.0);
    return vec2f(inside * inside * (3.0 - 2.0 * inside), 6.0 * inside * (1.0 - inside));
}

// A step that falls from 1 to 0 about `x = 1`, `edge` being half of its width.
struct Rim {
    value: f32,
    by_x: f32,
    by_edge: f32,
}

fn rim(x: f32, edge: f32) -> Rim {
    let inside = (1.0 - x) * (0.5 / edge);
    let k = cubic(inside + 0.5);
    return Rim(k.x, k.y * (-0.5 / edge), k.y * inside * (-1.0 / edge));
}

// How much of a shifted point lies in front of another, and its derivative.
fn ahead(distance: f32) -> vec2f {
    let scale = 0.5 / soft.width;
    return cubic(distance * scale + 0.5) * vec2f(1.0, scale);
}

// Whether a point at a distance along a ray lies on the piece, and the derivative by the distance.
fn between(distance: f32, ray: Ray) -> vec2f {
    return ahead(distance - ray.start) - ahead(distance - ray.end);
}

struct Chord {
    value: f32,
    by_along: f32,
    by_half: f32,
}

fn crossed(along: f32, half: f32, ray: Ray, two_sided: f32) -> Chord {
    let leaves_from = leaving(half, ray.start, two_sided);
    let leaves_to = leaving(half, ray.end, two_sided);
    let a = ahead(along - leaves_from.x);
    let b = ahead(along - leaves_to.x);
    let c = ahead(along - half - ray.start);
    let d = ahead(along - half - ray.end);
    let sum = a - b + c - d;
    return Chord(sum.x, sum.y, b.y * leaves_to.y - a.y * leaves_from.y - c.y + d.y);
}

// How far the centre may lie beyond the origin at most so that a ray of this length does not leave the ball, and the derivative
// by the half chord.
fn leaving(half: f32, length: f32, two_sided: f32) -> vec2f {
    let low = -two_sided * half;
    let leaving = min(length - half, half);
    let by_leaving = select(-1.0, 1.0, 2.0 * half < length);
    return vec2f(max(leaving, low), select(by_leaving, -two_sided, leaving < low));
}

// Half of the chord as a share of the radius, continued beyond the rim.
fn half_chord(x: f32, edge: f32) -> Rim {
    let root = 0.5 / sqrt(edge);
    if x < 1.0 - edge {
        let inside = sqrt(max(1.0 - x, 1e-12));
        return Rim(inside, -0.5 / inside, 0.0);
    }
    let outside = max(1.0 + edge - x, 0.0) * root;
    return Rim(outside, -root, root - outside * (0.5 / edge));
}

// A ball's value by the place of its centre relative to a segment.
struct Round {
    to_center: vec3f,
    across: vec3f,
    value: f32,
    by_across2: f32,
    by_along: f32,
    by_size: f32,
}

fn by_center(round: Round, ray: Ray) -> vec3f {
    return round.across * (2.0 * round.by_across2) + ray.direction * round.by_along;
}

fn put_round(round: Round, ray: Ray) {
    outputs[0] = round.value;
    put(1u, by_center(round, ray));
    outputs[7] = round.by_size;
}

// A sphere; seen only by segments towards the centre if it is not two-sided (1, else 0).
fn sphere(ray: Ray, two_sided: f32) -> Round {
    let to_center = soft.center - ray.origin;
    let along = dot(to_center, ray.direction);
    let across = to_center - ray.direction * along;
    let size = soft.half[0];
    let inverse2 = size.inverse * size.inverse;
    let x = dot(across, across) * inverse2;
    let disk = rim(x, size.edge);
    let chord = half_chord(x, size.edge);
    let window = crossed(along, chord.value * soft.radius, ray, two_sided);
    let by_chord = disk.value * window.by_half * soft.radius;
    let by_x = disk.by_x * window.value + by_chord * chord.by_x;
    let by_edge = disk.by_edge * window.value + by_chord * chord.by_edge;
    let value = size.share * (disk.value * window.value);
    let by_size = size_slope(size, value, x * by_x * 2.0 + size.edge * by_edge)
        + size.is_free * size.share * (by_chord * chord.value);
    let by_along = size.share * (disk.value * window.by_along);
    return Round(to_center, across, value, size.share * inverse2 * by_x, by_along, by_size);
}

// A disk that faces the origin; its plane's distance is regularised where the origin is nearer than the width.
fn facing_disk(ray: Ray) -> Round {
    let to_center = soft.center - ray.origin;
    let along = dot(to_center, ray.direction);
    let across = to_center - ray.direction * along;
    let across2 = dot(across, across);
    let size = soft.half[0];
    let inverse2 = size.inverse * size.inverse;
    let nearness = 1.0 / (along * along + soft.width * soft.width);
    let tilt = across2 * nearness;
    let x = across2 * (1.0 + tilt) * inverse2;
    let disk = rim(x, size.edge);
    let window = between(along * (1.0 + tilt), ray);
    let by_x = disk.by_x * window.x;
    let by_crossing = disk.value * window.y;
    let value = size.share * (disk.value * window.x);
    let twist = 2.0 * along * along * nearness;
    let by_across2 = size.share * (by_x * (1.0 + 2.0 * tilt) * inverse2 + by_crossing * along * nearness);
    let by_along = size.share
        * (by_crossing * (1.0 + tilt * (1.0 - twist)) - by_x * (2.0 * inverse2) * across2 * tilt * along * nearness);
    let by_size = size_slope(size, value, x * by_x * 2.0 + size.edge * (disk.by_edge * window.x));
    return Round(to_center, across, value, by_across2, by_along, by_size);
}

fn size_slope(size: Enlarged, value: f32, shrinking: f32) -> f32 {
    let free = value * (2.0 * (1.0 - size.share)) - (size.share * size.share) * shrinking;
    return select(2.0 * value, free, size.is_free != 0.0);
}

fn put_spot(ray: Ray) {
    let x = (1.0 + dot(ray.direction, soft.direction)) * soft.inverse_middle;
    let disk = rim(x, soft.edge);
    let light = soft.share * disk.value;
    let by_y = soft.share * soft.inverse_middle * disk.by_x;
    var value = light;
    var share: f32;
    var round: Round;
    var centre_slope: vec3f;
    if soft.kind == SOFT_SPOT {
        round = facing_disk(ray);
        share = round.value;
        centre_slope = by_center(round, ray) * light;
        round.by_size *= light;
    } else {
        // No cone for points inside of the sphere.
        round = sphere(ray, 0.0);
        let size = soft.half[0];
        let inverse2 = 1.0 / (soft.radius * soft.radius);
        let from_center = dot(round.to_center, round.to_center) * inverse2;
        let inside = rim(from_center, size.edge);
        let lifted = round.value * (1.0 - light);
        value = light + (1.0 - light) * inside.value;
        share = round.value * (1.0 - inside.value);
        centre_slope = by_center(round, ray) * value + round.to_center * (2.0 * inverse2 * (lifted * inside.by_x));
        let by_size_inside = 2.0 * (from_center * inside.by_x) + (size.share * size.edge) * inside.by_edge;
        round.by_size = round.by_size * value - size.is_free * (lifted * by_size_inside);
    }
    outputs[0] = round.value * value;
    put(1u, centre_slope);
    put(4u, cross(soft.direction, ray.direction) * (share * by_y));
    outputs[7] = round.by_size;
    outputs[9] = share * cone_slope(soft.by_angle, x, disk);
    outputs[10] = share * cone_slope(soft.by_blend, x, disk);
}

fn cone_slope(by: ConeSlope, x: f32, disk: Rim) -> f32 {
    return by.share * disk.value + soft.share * (by.edge * disk.by_edge - by.middle * (x * disk.by_x));
}

fn put_area(ray: Ray) {
    let normal = soft.direction;
    let to_center = soft.center - ray.origin;
    let cos = -dot(ray.direction, normal);
    let inverse_cos = 1.0 / max(cos, GRAZING);
    let distance = -dot(to_center, normal) * inverse_cos;
    let window = between(distance, ray);
    let front = emission(cos, inverse_cos);
    // The crossing relative to the centre, in the plane.
    let crossing = ray.direction * distance - to_center;
    let u = dot(crossing, soft.along_u);
    let v = dot(crossing, soft.along_v);
    let face = face(u, v);
    let scale = sqrt(soft.half[0].share * soft.half[1].share);
    let lit = scale * (window.x * front.x);
    let by_u = lit * face.by_u;
    let by_v = lit * face.by_v;
    let slide = by_u * dot(ray.direction, soft.along_u) + by_v * dot(ray.direction, soft.along_v);
    // By the height of the plane over the origin, along the normal.
    let by_height = (slide + scale * (window.y * front.x * face.value)) * inverse_cos;
    let by_cos = scale * (window.x * front.y * face.value);
    let value = lit * face.value;
    outputs[0] = value;
    put(1u, normal * -by_height - soft.along_u * by_u - soft.along_v * by_v);
    put(
        4u,
        cross(normal, crossing) * by_height + normal * (by_u * v - by_v * u) - cross(normal, ray.direction) * by_cos,
    );
    outputs[7] = edge_slope(soft.half[0], value, lit * face.shrinking.x);
    outputs[8] = edge_slope(soft.half[1], value, lit * face.shrinking.y);
}

// As `size_slope` for an edge, whose length scales the value once.
fn edge_slope(half: Enlarged, value: f32, shrinking: f32) -> f32 {
    return select(value, value * (1.0 - half.share) - half.share * shrinking, half.is_free != 0.0);
}

// Radiance by the cosine to the normal, and its derivative.
fn emission(cos: f32, inverse_cos: f32) -> vec2f {
    let front = cubic(cos / soft.fade) * vec2f(1.0, 1.0 / soft.fade);
    if soft.normalisation == 0.0 {
        return front;
    }
    let sin = sqrt(max(1.0 - cos * cos, 1e-12));
    let left = soft.tan_half - sin * inverse_cos;
    let above = max(left + soft.knee, 0.0);
    let is_below = left < soft.knee;
    let spread = select(left, above * above * (0.25 / soft.knee), is_below);
    // The tangent falls by 1 / (sin cos^2) as the cosine grows.
    let rise = inverse_cos * inverse_cos / sin;
    let slope = select(1.0, above * (0.5 / soft.knee), is_below) * rise;
    return soft.normalisation * vec2f(front.x * spread, front.y * spread + front.x * slope);
}

// How much of a face is there at a point of its plane, with derivatives by the point and by the logarithms of the enlarged half
// edges, the latter with their signs reversed.
struct Face {
    value: f32,
    by_u: f32,
    by_v: f32,
    shrinking: vec2f,
}

fn face(u_metres: f32, v_metres: f32) -> Face {
    let half_u = soft.half[0];
    let half_v = soft.half[1];
    let u = u_metres * half_u.inverse;
    let v = v_metres * half_v.inverse;
    if soft.kind == ELLIPSE {
        let edge = sqrt(half_u.edge * half_v.edge);
        let disk = rim(u * u + v * v, edge);
        let shrinking = 2.0 * vec2f(u * u, v * v) * disk.by_x + (0.5 * edge) * disk.by_edge;
        let by = 2.0 * vec2f(half_u.inverse * u, half_v.inverse * v) * disk.by_x;
        return Face(disk.value, by.x, by.y, shrinking);
    }
    let strip_u = rim(abs(u), half_u.edge);
    let strip_v = rim(abs(v), half_v.edge);
    let slope_u = strip_u.by_x * sign(u);
    let slope_v = strip_v.by_x * sign(v);
    let shrinking_u = (slope_u * u + half_u.edge * strip_u.by_edge) * strip_v.value;
    let shrinking_v = (slope_v * v + half_v.edge * strip_v.by_edge) * strip_u.value;
    return Face(
        strip_u.value * strip_v.value,
        half_u.inverse * slope_u * strip_v.value,
        half_v.inverse * slope_v * strip_u.value,
        vec2f(shrinking_u, shrinking_v),
    );
}

fn put_sun(ray: Ray) {
    let size = soft.half[0];
    let apart = ray.direction - soft.direction;
    let x = dot(apart, apart) * (size.inverse * size.inverse);
    let disk = rim(x, size.edge);
    let value = size.share * disk.value;
    outputs[0] = value;
    put(4u, cross(soft.direction, ray.direction) * (-2.0 * size.share * size.inverse * size.inverse * disk.by_x));
    let by_chord = size_slope(size, value, 2.0 * (x * disk.by_x) + size.edge * disk.by_edge);
    outputs[7] = by_chord * (0.5 * soft.chord2_by_angle);
}
