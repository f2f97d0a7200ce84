use crate::LightKind;

/// Errors of training, using, saving or opening a proxy. Each message names the next step.
#[derive(Debug, thiserror::Error)]
pub enum ProxyError {
    /// Pixel features whose arrays do not match the image size, or that hold NaN or infinity.
    #[error("pixel features: {0}; build them again from the AOVs of this dump")]
    Features(String),
    /// A configuration that cannot be trained.
    #[error("training configuration: {0}")]
    Config(String),
    /// A light that this proxy has not been trained for.
    #[error("this proxy was trained for {trained} lights, not for {asked}; relight this light by gathering")]
    WrongKind {
        /// Kind of lights that the proxy knows.
        trained: LightKind,
        /// Kind of light that was asked for.
        asked: LightKind,
    },
    /// A slice of the wrong length was handed in.
    #[error("{what}: expected {expected} values, got {found}")]
    Length {
        /// Name of the argument.
        what: &'static str,
        /// Expected number.
        expected: usize,
        /// Number found.
        found: usize,
    },
    /// A pixel number outside the image.
    #[error("pixel {pixel} lies outside an image of {count} pixels")]
    PixelOutside {
        /// The number asked for.
        pixel: u32,
        /// Pixels in the image.
        count: usize,
    },
    /// A gathered value that is not finite.
    #[error("the target of pixel {pixel} is not finite; validate the dump")]
    BadTarget {
        /// The pixel, row-major.
        pixel: u32,
    },
    /// The loss is no longer a number.
    #[error("training diverged at step {step}; lower the learning rates")]
    Diverged {
        /// First step with a loss that is not finite.
        step: u64,
    },
    /// The GPU failed, or has not what is needed.
    #[error(transparent)]
    Gpu(#[from] relume_gpu::GpuError),
    /// The source of targets failed.
    #[error("targets: {0}")]
    Targets(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// Reading or writing a file failed.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: String,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A file that is not a proxy, is damaged, or comes from another version.
    #[error("{path}: {reason}")]
    Format {
        /// The file.
        path: String,
        /// Fault and next step, in words.
        reason: String,
    },
}

impl ProxyError {
    /// Wraps the failure of a [`crate::TargetSource`].
    pub fn targets(source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        Self::Targets(source.into())
    }
}
