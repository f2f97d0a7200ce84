//! Whole paths in small scenes with known answers.

mod determinism;
mod emission;
mod failures;
mod furnace;
mod lights;
mod limits;
mod support;
mod surfaces;
