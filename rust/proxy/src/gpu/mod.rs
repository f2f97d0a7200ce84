//! The networks on a GPU.
