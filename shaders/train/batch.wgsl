// The columns of a part of a batch. Activations lie `[row][column]`, so that neighbouring threads read neighbouring
// values. Columns are samples (pixel and light), pixels, or lights: sample `n` belongs to tile `n / 32`, which has one
// light; tiles of one group of 32 pixels follow each other.

const SAMPLES: u32 = 0u;
const PIXELS: u32 = 1u;
const LIGHTS: u32 = 2u;

/// Samples of a tile, pixels of a group.
const LANES: u32 = 32u;
/// Samples of a chunk, the unit in which the store is drawn from.
const CHUNK: u32 = 1024u;

struct Batch {
    /// Samples of this part, a multiple of CHUNK.
    samples: u32,
    /// Samples that the activations have room for.
    capacity: u32,
    /// Lights of each pixel.
    slots: u32,
}

/// Columns in use.
fn columns(batch: Batch, space: u32) -> u32 {
    return per_space(batch.samples, batch.slots, space);
}

/// Values from a row of the activations to the next.
fn row_stride(batch: Batch, space: u32) -> u32 {
    return per_space(batch.capacity, batch.slots, space);
}

fn per_space(samples: u32, slots: u32, space: u32) -> u32 {
    switch space {
        case PIXELS: { return samples / slots; }
        case LIGHTS: { return samples / LANES; }
        default: { return samples; }
    }
}

/// Pixel column of a sample.
fn pixel_of(batch: Batch, sample: u32) -> u32 {
    return sample / (LANES * batch.slots) * LANES + sample % LANES;
}
