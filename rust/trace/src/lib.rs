//! Light-free path tracing: scene -> dump.
//!
//! [`Tracer`] (or [`trace`]) samples camera paths and hands them, tile by tile and pass by pass, to a
//! [`relume_dump::ShardSink`]. Directions come from the BSDFs and in part from where the file's lights stand, which changes only
//! the noise. What the scene itself emits goes to static layers, so that any virtual light can be
//! added up from the paths later.

pub mod bsdf;
pub mod bvh;
pub mod camera;
mod connect;
mod data_passes;
mod discrete;
mod displace;
mod emitters;
mod environment;
pub mod filter;
mod guide;
mod integrator;
mod light_classes;
mod media;
mod path;
mod ray_offset;
mod render;
pub mod sampler;
pub mod settings;
pub mod shading;
mod shutter;
mod static_light;
mod strand;
pub mod subdivide;
mod subsurface;
mod vertex;

pub use connect::{
    ConnectScratch, LightCenter, PathVertex, PixelVertices, ShadowTarget, UnpackedVertex, VertexLimits,
    VertexPlace,
};
pub use data_passes::{DataPassSettings, DataPasses, DataTracer, matte_id, murmur3};
pub use displace::displace;
pub use guide::{Guide, hit_probability};
pub use integrator::{PathScratch, PathSink};
pub use media::reaches_beyond;
pub use render::{Control, TraceError, TraceOutcome, TraceProgress, Tracer, guide_targets, manifest, trace};
pub use settings::TraceSettings;
