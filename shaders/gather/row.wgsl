// A pixel in the table of a chunk of records.
struct Pixel {
    // Row by row in the image.
    image: u32,
    // Its parts go on to the first one of the next pixel.
    first_part: u32,
    // 1 / samples.
    scale: f32,
}
