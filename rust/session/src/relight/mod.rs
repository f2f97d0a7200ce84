//! Lights to pictures.

pub(crate) mod denoise;
pub(crate) mod relighter;
pub(crate) mod relit;
pub(crate) mod unit_cache;
