//! Light-free path tracing: BVH, BSDFs, samplers; scene -> dump.
