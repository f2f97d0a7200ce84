//! The networks on a GPU.

mod compare;
mod exact;
mod gradient;
mod matrices;
mod network;
mod proxy;
pub(crate) mod train;

pub use compare::{ProxyCompared, compare};
pub use gradient::LightGradient;
pub(crate) use network::{DeviceNetwork, OnDevice, Parts};
pub use proxy::GpuProxy;

#[cfg(test)]
mod tests;
