// use: train/batch
// Dense layers and how they hang together: one row of a table for each, the same for all kernels.

struct Layer {
    /// First weight, values from row to row; first bias.
    weights: u32,
    stride: u32,
    bias: u32,
    inputs: u32,
    outputs: u32,
    space: u32,
    /// Activations: first value of the input, of the output, and of the gradients by the product and by the input, which
    /// nobody may need (NOTHING).
    input: u32,
    output: u32,
    d_product: u32,
    d_input: u32,
    /// Kind of step after the product: FINISH_*.
    finish: u32,
    /// First scale of a modulated layer (its shifts follow), and its product before modulation; where the product
    /// is added to a modulated trunk, that trunk.
    modulation: u32,
    product: u32,
    /// Kind of step before the input: BEFORE_*; then the modulation of the layer before, the gradient by it, its product or
    /// its trunk.
    before: u32,
    before_modulation: u32,
    before_d_modulation: u32,
    before_product: u32,
    /// Rows of a pixel, which begin at `input`, and where those of its light begin, which come after them: of a layer over
    /// samples whose input is not kept by sample. Of others NOTHING.
    pixel_rows: u32,
    light_rows: u32,
}

/// Product plus bias.
const FINISH_LINEAR: u32 = 0u;
/// ReLU of product plus bias.
const FINISH_RELU: u32 = 1u;
/// ReLU of the modulated product.
const FINISH_MODULATED: u32 = 2u;
/// ReLU of the product plus the modulated trunk.
const FINISH_TRUNK: u32 = 3u;

/// The network's input.
const BEFORE_NOTHING: u32 = 0u;
/// A layer with FINISH_RELU.
const BEFORE_RELU: u32 = 1u;
/// A layer with FINISH_MODULATED.
const BEFORE_MODULATED: u32 = 2u;
/// The layer with FINISH_TRUNK.
const BEFORE_TRUNK: u32 = 3u;

/// Instead of a place, where there is none.
const NOTHING: u32 = 0xffffffffu;

/// Layers that one dispatch runs: chains of layers over the same columns, of which each takes the output of the one before it.
struct Chains {
    batch: Batch,
    /// Row of the table of the first layer of the first chain, layers of a chain, rows from chain to chain, chains.
    first: u32,
    length: u32,
    pitch: u32,
    count: u32,
    /// Factor on gradients while they are multiplied, a power of two: 16 bits hold no smaller numbers than 6e-8.
    scale: f32,
}
