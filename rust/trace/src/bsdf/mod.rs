//! Closures and the choice between them: sampling, evaluation and densities of a surface's scattering.

mod surface;

pub use surface::{BsdfSample, Closure, Surface};
