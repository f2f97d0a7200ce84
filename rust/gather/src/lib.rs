//! Sums lights over a dump: dump + lights -> image; denoising.
