/// Why lights could not be gathered or an image denoised.
#[derive(Debug, thiserror::Error)]
pub enum GatherError {
    /// A light that has no image.
    #[error("light '{name}' cannot be gathered: {reason}; correct it or leave the light out")]
    Light {
        /// Object name.
        name: String,
        /// Fault of the light, in words.
        reason: &'static str,
    },
    /// An environment texture whose size and texels disagree.
    #[error("environment image '{name}' has {found} values instead of {expected}; reload the image")]
    Environment {
        /// Image name.
        name: String,
        /// Values that there are.
        found: usize,
        /// Values that the size needs.
        expected: usize,
    },
    /// A softness that no light can be smoothed by.
    #[error("a softness of {0} is not above 0 and at most 1; choose another")]
    Softness(f32),
    /// A cell that is not there.
    #[error("there is no cell {cell} among {cells}; count them from 0, row by row")]
    Cell {
        /// Requested cell.
        cell: u32,
        /// Number of cells.
        cells: usize,
    },
    /// A dump that cannot be packed.
    #[error(transparent)]
    Dump(#[from] relume_dump::DumpError),
    /// The GPU.
    #[error(transparent)]
    Gpu(#[from] relume_gpu::GpuError),
}
