// use: train/batch
// A row of the store of lights: parameters in units of the scene, weight in the loss, one over the scale of outputs
// (where targets are gathered on the device), inputs of the networks.

/// Values of a row.
const LIGHT_ROW: u32 = 49u;
const LIGHT_WEIGHT: u32 = 9u;
const LIGHT_INVERSE_SCALE: u32 = 10u;
const LIGHT_INPUTS: u32 = 11u;
