//! The path dump: segments of light-free paths, pixel by pixel, and the AOVs.
//!
//! A dump is a folder: `manifest.json` and one `safetensors` shard for each image tile and sampling pass. Shards
//! are self-contained: an interrupted bake resumes after the last complete one, several machines can bake tiles
//! of one image, and readers map them into memory.

mod segment;

pub use segment::{End, Lobe, Segment};
