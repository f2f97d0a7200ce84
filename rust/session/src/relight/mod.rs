//! Lights to pictures: the one core of the live view, F12, the command line and the solver.
//!
//! ```text
//! source: proxy or gather  -->  units: unit image of each light, cached  --+
//!                               statics: emitters and world  --------------+-->  frame: weighted sum, denoised
//! ```

pub(crate) mod denoise;
pub(crate) mod film;
pub(crate) mod frame;
pub(crate) mod gathered;
pub(crate) mod light_cache;
pub(crate) mod notes;
pub(crate) mod options;
pub(crate) mod relighter;
pub(crate) mod relit;
pub(crate) mod source;
pub(crate) mod statics;
pub(crate) mod units;
pub(crate) mod upsample;
