// use: train/batch
// Rows of the store.

/// A pixel: what is known of it, its surface, factors on its outputs.
const PIXEL_ROW: u32 = 25u;
const PIXEL_SURFACE: u32 = 13u;
const PIXEL_FACTORS: u32 = 22u;

/// A light: parameters in units of the scene, weight in the loss, one over the scale of outputs (for targets that are made on
/// the device), inputs of the networks.
const LIGHT_ROW: u32 = 49u;
const LIGHT_WEIGHT: u32 = 9u;
const LIGHT_INVERSE_SCALE: u32 = 10u;
const LIGHT_INPUTS: u32 = 11u;
