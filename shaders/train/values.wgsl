// choose: MATRICES train/product train/product_matrices
// constant: MATRICES 0
// What products read of the activations, by either kind of product.

/// Parts of a slab that a thread fills one after the other, each 16 deep.
const SLAB_PARTS: u32 = SLAB / 16u;

fn value_at(place: u32) -> f32 {
    return activations[place / 4u][place % 4u];
}

/// Four columns of a row of a layer's input.
fn input_four(layer: Layer, batch: Batch, row: u32, column: u32) -> vec4f {
    if layer.pixel_rows == NOTHING {
        return activations[(layer.input + row * row_stride(batch, layer.space) + column) / 4u];
    }
    if row < layer.pixel_rows {
        return activations[(layer.input + row * row_stride(batch, PIXELS) + pixel_of(batch, column)) / 4u];
    }
    let light_row = row - layer.pixel_rows;
    return vec4f(value_at(layer.light_rows + light_row * row_stride(batch, LIGHTS) + column / LANES));
}
