// use: train/batch
// A row of the store of pixels: what is known of a pixel, its surface, factors on its outputs.

/// Values of a row.
const PIXEL_ROW: u32 = 25u;
const PIXEL_SURFACE: u32 = 13u;
const PIXEL_FACTORS: u32 = 22u;

// A row of the store of lights: parameters in units of the scene, weight in the loss, one over the scale of outputs
// (where targets are gathered on the device), inputs of the networks.

/// Values of a row.
const LIGHT_ROW: u32 = 49u;
const LIGHT_WEIGHT: u32 = 9u;
const LIGHT_INVERSE_SCALE: u32 = 10u;
const LIGHT_INPUTS: u32 = 11u;
