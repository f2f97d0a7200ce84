// use: proxy/train_batch
// A row of the store of lights: parameters in units of the scene, weight in the loss, inputs of the networks.

/// Values of a row.
const LIGHT_ROW: u32 = 48u;
const LIGHT_WEIGHT: u32 = 9u;
const LIGHT_INPUTS: u32 = 10u;
