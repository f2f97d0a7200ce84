//! Devices that work runs on: CPU threads, or a GPU with the CPU to fall back on.

pub(crate) mod blocks;
pub(crate) mod compute;
pub(crate) mod connections;
pub(crate) mod gather;
pub(crate) mod image;
pub(crate) mod layers;
pub(crate) mod on_gpu;
pub(crate) mod proxies;
mod sorting;
pub(crate) mod threads;
