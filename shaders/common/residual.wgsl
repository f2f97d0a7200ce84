// How far an exposed cell is from what is asked for: `goal.rs` of `optimise`, which tells where the numbers come from.

// What is compared: `Residual` of `compare.rs`.
const TONE: u32 = 0u;
const BRIGHTNESS: u32 = 1u;
const COLOR: u32 = 2u;
const WARMTH: u32 = 3u;
const STOPS: u32 = 4u;

const STOP: f32 = 0.173;
const EXCESS: f32 = 0.3;
const SHORT: f32 = 2.0;
const FLOOR: f32 = 0.01;
const CHROMA: f32 = 0.3;
const SIDE: f32 = 0.3;
const SIDE_OF_MEAN: f32 = 0.2;
const LUMINANCE = vec3f(0.2126, 0.7152, 0.0722);
const LOG2_E: f32 = 1.44269504;

struct Residual {
    values: vec3f,
    // Derivatives by the channels of the cell, a column for each value.
    slopes: mat3x3f,
}

// A number, and its derivatives by the channels of a cell.
struct Sloped { value: f32, by: vec3f }

// `amount` tells by its sign whether more or less is wanted, so that too much counts less than too little.
fn residual(kind: u32, amount: f32, x: vec3f, reference: vec3f) -> Residual {
    switch kind {
        case TONE: { return tone_residual(x, reference); }
        case BRIGHTNESS: {
            return brightness_residual(select(EXCESS, 1.0, is_short(amount, x, reference)), SIDE, x, reference);
        }
        case COLOR: { return color_residual(x, reference); }
        case WARMTH: { return warmth_residual(amount, x, reference); }
        default: { return stops_residual(x, reference); }
    }
}

// The same of the mean of cells, of which what was asked for is wanted and no more.
fn residual_of_mean(kind: u32, amount: f32, mean: vec3f, reference: vec3f) -> Residual {
    if kind == BRIGHTNESS {
        let weight = select(1.0, SHORT, is_short(amount, mean, reference));
        return brightness_residual(weight, SIDE_OF_MEAN, mean, reference);
    }
    return residual(kind, amount, mean, reference);
}

// The paper's equation 6, continued as an odd function below 0.
fn tone_residual(x: vec3f, reference: vec3f) -> Residual {
    let scale = 1.0 / (1.0 + abs(x));
    return Residual(x * scale - reference, diagonal(scale * scale));
}

// Whether less brightness was gained, or lost, than was asked for.
fn is_short(amount: f32, x: vec3f, reference: vec3f) -> bool {
    return (stops_of_luminance(x).value - reference.x) * amount < 0.0;
}

// `weight` is what a difference of stops counts, `side_weight` what one of the colour ratios does.
fn brightness_residual(weight: f32, side_weight: f32, x: vec3f, reference: vec3f) -> Residual {
    let brightness = stops_of_luminance(x);
    let red = ratio(x, 0u, 1u);
    let blue = ratio(x, 2u, 1u);
    let scale = STOP * weight;
    let side = side_weight * CHROMA;
    return Residual(
        vec3f(
            scale * (brightness.value - reference.x), side * (red.value - reference.y), side * (blue.value - reference.z),
        ),
        mat3x3f(scale * brightness.by, side * red.by, side * blue.by),
    );
}

fn color_residual(x: vec3f, reference: vec3f) -> Residual {
    let floored = max(dot(LUMINANCE, x), 0.0) + FLOOR;
    let share = x / floored;
    let scale = CHROMA / floored;
    return Residual(
        CHROMA * (share - reference),
        mat3x3f(
            scale * (vec3f(1.0, 0.0, 0.0) - share.x * LUMINANCE),
            scale * (vec3f(0.0, 1.0, 0.0) - share.y * LUMINANCE),
            scale * (vec3f(0.0, 0.0, 1.0) - share.z * LUMINANCE),
        ),
    );
}

fn warmth_residual(amount: f32, x: vec3f, reference: vec3f) -> Residual {
    let warmth = ratio(x, 0u, 2u);
    let brightness = stops_of_luminance(x);
    let difference = warmth.value - reference.x;
    let scale = CHROMA * select(EXCESS, 1.0, difference * amount < 0.0);
    let side = SIDE * STOP;
    return Residual(
        vec3f(scale * difference, side * (brightness.value - reference.y), 0.0),
        mat3x3f(scale * warmth.by, side * brightness.by, vec3f()),
    );
}

fn stops_residual(x: vec3f, reference: vec3f) -> Residual {
    let slopes = select(vec3f(), LOG2_E / (x + FLOOR), x > vec3f());
    return Residual(STOP * (log2(max(x, vec3f()) + FLOOR) - reference), diagonal(STOP * slopes));
}

fn stops_of_luminance(x: vec3f) -> Sloped {
    let luminance = dot(LUMINANCE, x);
    let slope = select(0.0, LOG2_E / (luminance + FLOOR), luminance > 0.0);
    return Sloped(log2(max(luminance, 0.0) + FLOOR), slope * LUMINANCE);
}

// The logarithm of the ratio of two channels.
fn ratio(x: vec3f, above: u32, below: u32) -> Sloped {
    let floored = max(x, vec3f()) + FLOOR;
    var by = vec3f();
    by[above] = select(0.0, 1.0 / floored[above], x[above] > 0.0);
    by[below] = select(0.0, -1.0 / floored[below], x[below] > 0.0);
    return Sloped(log(floored[above] / floored[below]), by);
}

fn diagonal(values: vec3f) -> mat3x3f {
    return mat3x3f(values.x, 0.0, 0.0, 0.0, values.y, 0.0, 0.0, 0.0, values.z);
}
