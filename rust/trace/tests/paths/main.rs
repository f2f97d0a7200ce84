//! Whole paths in small scenes with known answers.

#![expect(clippy::unwrap_used, reason = "a panic fails the test")]

mod catcher;
mod determinism;
mod emission;
mod failures;
mod fast_gi;
mod film;
mod furnace;
mod lights;
mod limits;
mod media;
mod motion;
mod shadow_rays;
mod subsurface;
mod support;
mod surfaces;
