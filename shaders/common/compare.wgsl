// The loss of goals between a picture and what they want of it, and its gradient by the picture: `term.rs` of `optimise`. A
// workgroup does all of a goal: steps look at so few cells that more of them would wait for each other for longer than that takes.
// use: common/residual

const GROUP: u32 = 256u;
// What single cells count beside their mean: of what was asked for, and of what is kept.
const EVEN: f32 = 0.01;
const EVENLY_KEPT: f32 = 0.2;
// Larger ones are those of a black picture.
const MOST_GAIN: f32 = 1e30;

struct Arguments {
    // Goals.
    terms: u32,
}

// A goal at its cells, which follow each other.
struct Term {
    // What their mean is compared to.
    mean_reference: array<f32, 3>,
    residual: u32,
    // Stops or mireds that were asked for.
    amount: f32,
    exposure: f32,
    // The sum of the shares.
    weight: f32,
    // Mean luminance, times the weight, that the exposure of cells is brought to before they are compared; 0 if it matters as it is.
    luminance: f32,
    first: u32,
    count: u32,
}

@group(0) @binding(0) var<storage, read> terms: array<Term>;
// Of each cell what it is compared to, and its share in the loss.
@group(0) @binding(1) var<storage, read> wanted: array<vec4f>;
@group(0) @binding(2) var<storage, read> picture: array<f32>;
@group(0) @binding(3) var<storage, read_write> d_picture: array<f32>;
// A loss for each goal comes first.
@group(0) @binding(4) var<storage, read_write> results: array<f32>;

var<immediate> arguments: Arguments;
var<workgroup> sums: array<vec4f, GROUP>;

@compute @workgroup_size(GROUP)
fn compare(
    @builtin(local_invocation_index) thread: u32,
    @builtin(workgroup_id) group_id: vec3u,
    @builtin(num_workgroups) groups: vec3u,
) {
    let number = group_id.x + group_id.y * groups.x;
    if number >= arguments.terms { return; }
    let term = terms[number];
    let end = term.first + term.count;

    var own = vec4f();
    for (var cell = term.first + thread; cell < end; cell += GROUP) {
        own += wanted[cell].w * vec4f(exposed(term, cell), 0.0);
    }
    let sum = total(thread, own).xyz;
    let gain = gain_of(term, dot(LUMINANCE, sum));
    let whole = whole_residual(term, sum / term.weight);
    let d_whole = whole.slopes * whole.values;
    let of_cells = weight_of_cells(term.residual);

    // Loss, and what the gain is pulled by.
    own = vec4f();
    for (var cell = term.first + thread; cell < end; cell += GROUP) {
        let x = exposed(term, cell);
        let at = residual(term.residual, term.amount, gain.value * x, wanted[cell].xyz);
        let share = wanted[cell].w;
        let d = 2.0 * share * (of_cells * (at.slopes * at.values) + d_whole);
        for (var channel = 0u; channel < 3u; channel++) { d_picture[3u * cell + channel] = d[channel]; }
        own += vec4f(share * dot(at.values, at.values), dot(d, x), 0.0, 0.0);
    }
    let pulled = total(thread, own);
    let by_gain = pulled.y * gain.by;
    for (var cell = term.first + thread; cell < end; cell += GROUP) {
        for (var channel = 0u; channel < 3u; channel++) {
            let d = gain.value * d_picture[3u * cell + channel] + wanted[cell].w * by_gain[channel];
            d_picture[3u * cell + channel] = term.exposure * d;
        }
    }
    if thread == 0u { results[number] = of_cells * pulled.x + term.weight * dot(whole.values, whole.values); }
}

// What brings cells to the luminance that is wanted, and its derivatives by the sum of the exposed cells times their shares.
fn gain_of(term: Term, luminance: f32) -> Sloped {
    let gain = term.luminance / luminance;
    if !(term.luminance * luminance > 0.0 && gain < MOST_GAIN) { return Sloped(1.0, vec3f()); }
    return Sloped(gain, -gain / luminance * LUMINANCE);
}

// A target asks for each cell by itself.
fn whole_residual(term: Term, mean: vec3f) -> Residual {
    if term.residual == TONE { return Residual(); }
    let reference = vec3f(term.mean_reference[0], term.mean_reference[1], term.mean_reference[2]);
    return residual_of_mean(term.residual, term.amount, mean, reference);
}

// A target asks for single cells alone.
fn weight_of_cells(kind: u32) -> f32 {
    switch kind {
        case TONE: { return 1.0; }
        case STOPS: { return EVENLY_KEPT; }
        default: { return EVEN; }
    }
}

// The sum of a value of each thread.
fn total(thread: u32, own: vec4f) -> vec4f {
    sums[thread] = own;
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if thread < half { sums[thread] += sums[thread + half]; }
    }
    workgroupBarrier();
    let sum = sums[0];
    workgroupBarrier();
    return sum;
}

fn exposed(term: Term, cell: u32) -> vec3f {
    return term.exposure * vec3f(picture[3u * cell], picture[3u * cell + 1u], picture[3u * cell + 2u]);
}
