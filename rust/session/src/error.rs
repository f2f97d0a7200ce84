use relume_gather::GatherError;
use relume_optimise::OptimiseError;
use relume_proxy::ProxyError;
use std::path::PathBuf;

/// Why a stage stopped. Each message names the file, object or option, and what to do next.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The caller asked to stop; what is complete has been kept.
    #[error("stopped; start it again with --resume to go on")]
    Cancelled,
    /// A file or folder could not be read or written.
    #[error("cannot {action}: {source} ({})", path.display())]
    Io {
        /// What was tried, in words.
        action: &'static str,
        /// File or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A light set cannot be used.
    #[error("light set {}: {reason}", path.display())]
    Lights {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A setting cannot be used.
    #[error("{0}")]
    Settings(String),
    /// Tracer.
    #[error(transparent)]
    Trace(#[from] relume_trace::TraceError),
    /// Dump.
    #[error(transparent)]
    Dump(#[from] relume_dump::DumpError),
    /// Gather.
    #[error(transparent)]
    Gather(#[from] GatherError),
    /// GPU.
    #[error(transparent)]
    Gpu(#[from] relume_gpu::GpuError),
    /// Denoiser.
    #[error(transparent)]
    Denoise(#[from] relume_gather::DenoiseError),
    /// Picture.
    #[error(transparent)]
    Image(#[from] relume_image::ImageError),
    /// Proxy.
    #[error(transparent)]
    Proxy(#[from] ProxyError),
    /// Solver.
    #[error(transparent)]
    Optimise(#[from] OptimiseError),
    /// OBJ file.
    #[error(transparent)]
    Obj(#[from] relume_scene::ObjError),
    /// Scene.
    #[error(transparent)]
    Scene(#[from] relume_scene::BuildError),
}

impl SessionError {
    /// Whether a GPU has failed, so that the same on the CPU may work.
    pub(crate) fn is_of_gpu(&self) -> bool {
        match self {
            Self::Gpu(_) | Self::Gather(GatherError::Gpu(_)) | Self::Proxy(ProxyError::Gpu(_)) => true,
            Self::Proxy(ProxyError::Targets(error)) => {
                matches!(error.downcast_ref(), Some(GatherError::Gpu(_)))
            }
            Self::Optimise(OptimiseError::Relight(error)) => {
                matches!(error.downcast_ref(), Some(ProxyError::Gpu(_)))
            }
            _ => false,
        }
    }

    pub(crate) fn io(action: &'static str, path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io { action, path, source }
    }
}
