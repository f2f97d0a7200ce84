// Encoded pixels, in tiles of 32: `[tile][row][32]`.
// constant: PIXEL_ROWS 76

fn encoded_at(pixel: u32, row: u32) -> u32 { return ((pixel / 32u) * PIXEL_ROWS + row) * 32u + pixel % 32u; }
