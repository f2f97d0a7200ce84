//! The networks on a GPU.

mod network;
mod proxy;

pub(crate) use network::{DeviceNetwork, OnDevice};
pub use proxy::GpuProxy;

#[cfg(test)]
mod tests;
