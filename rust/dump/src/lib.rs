//! The path dump: segments of light-free paths, pixel by pixel, and the AOVs.
//!
//! A dump is a folder: `manifest.json` ([`Manifest`]) and one `safetensors` shard ([`Shard`]) for each image tile
//! and sampling pass. Shards are self-contained: an interrupted bake resumes after the last complete one, several
//! machines can bake tiles of one image, and readers map them into memory.
//!
//! # Shards
//! 12 bytes a record, as three streams, so that the gather reads a throughput only where a light is hit:
//!
//! | tensor | type and shape | meaning |
//! |---|---|---|
//! | `pixel_offsets` | u32 `[P + 1]` | first record of each pixel of the tile, then the number of records |
//! | `position_xy` | u32 `[N]` | grid x, y << 16; or the octahedral direction of an escaped segment |
//! | `position_z_flags` | u32 `[N]` | grid z, [`Flags`] << 16 |
//! | `throughput` | u32 `[N]` | rgb9e5, dithered so that its expected value is exact |
//! | `aov` | f32 `[P, 16]` | [`aov_channel`], sums over the samples of the pass |
//!
//! A record is the segment from the end of the record before to its own position. The first segment of a path
//! starts at the camera position, or at an *origin record* (lobe code 7, not a segment) where the camera is not a
//! pinhole. A segment of throughput 0 only moves a path on. Segments behind transparent surfaces and null collisions
//! *continue* a ray, which crosses a light once however many pieces it has. Every pixel has exactly as many paths as the pass has samples, so half of them can be taken by path number.
//! Where lights have rules of their own, such as shadow linking, receiver numbers count classes too ([`SegmentClasses`]).
//! Positions are 16-bit coordinates in the shard's bounding box ([`Grid`]), which the metadata holds with the tile, the
//! samples, and a BLAKE3 checksum of everything.

mod classes;
mod dump;
mod error;
mod manifest;
mod packing;
mod records;
mod samples;
mod segment;
mod shard;
mod writer;

pub use classes::{SegmentClasses, Sight};
pub use dump::{AovSums, Aovs, Dump, ShardFault};
pub use error::DumpError;
pub use manifest::{FORMAT_VERSION, Manifest, Pass, TileRect};
pub use packing::{
    Flags, Grid, RECEIVER_LIMIT, RGB9E5_MAX, decode_direction, decode_rgb9e5, dither, encode_direction,
    encode_rgb9e5,
};
pub use samples::{AOV_CHANNELS, AovSample, TileSamples, aov_channel};
pub use segment::{ByConnectedLobe, End, Lobe, Segment};
pub use shard::{DecodedSegment, Shard, ShardHeader};
pub use writer::{DumpWriter, MemoryWriter, ShardSink};
