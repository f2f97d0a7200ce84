//! The path dump: segments of light-free paths, pixel by pixel, and the AOVs.
