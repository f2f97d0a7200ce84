use relume_gather::GatherError;
use relume_gpu::GpuError;
use relume_optimise::OptimiseError;
use relume_proxy::ProxyError;
use std::path::PathBuf;

/// Reason why a stage stopped. Each message names the file, object or option, and the next step.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The caller asked to stop; what is complete has been kept.
    #[error("stopped; what is whole was kept, and bake and train go on with --resume")]
    Cancelled,
    /// A file or folder could not be read or written.
    #[error("cannot {action}: {source} ({})", path.display())]
    Io {
        /// Action that failed, in words.
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
        /// Fault.
        reason: String,
    },
    /// A scene file cannot be used.
    #[error("scene file {}: {reason}", path.display())]
    SceneFile {
        /// The file.
        path: PathBuf,
        /// Fault.
        reason: String,
    },
    /// A list of shots cannot be used.
    #[error("list of shots {}: {reason}", path.display())]
    Shots {
        /// The file.
        path: PathBuf,
        /// Fault.
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
    /// True if a file could not be read or written: the same may succeed later, or on another machine.
    pub fn may_pass(&self) -> bool {
        use relume_dump::DumpError;
        use relume_trace::TraceError;
        matches!(
            self,
            Self::Io { .. }
                | Self::Dump(DumpError::Io { .. })
                | Self::Trace(TraceError::Dump(DumpError::Io { .. }) | TraceError::Threads { .. })
        )
    }

    /// True if a GPU failed, so that the CPU may succeed.
    pub(crate) fn is_of_gpu(&self) -> bool {
        self.of_gpu().is_some()
    }

    /// Reason why a GPU was lost, if it was. It may work once opened anew.
    pub(crate) fn lost_gpu(&self) -> Option<&str> {
        match self.of_gpu()? {
            GpuError::Lost(reason) => Some(reason),
            _ => None,
        }
    }

    fn of_gpu(&self) -> Option<&GpuError> {
        match self {
            Self::Gpu(error)
            | Self::Gather(GatherError::Gpu(error))
            | Self::Proxy(ProxyError::Gpu(error)) => Some(error),
            Self::Proxy(ProxyError::Targets(error)) => match error.downcast_ref()? {
                GatherError::Gpu(error) => Some(error),
                _ => None,
            },
            Self::Optimise(OptimiseError::Relight(error)) => match error.downcast_ref()? {
                ProxyError::Gpu(error) => Some(error),
                _ => None,
            },
            _ => None,
        }
    }

    pub(crate) fn io(action: &'static str, path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io { action, path, source }
    }
}
