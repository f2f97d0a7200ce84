use std::io;
use std::path::{Path, PathBuf};

/// Why a dump could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum DumpError {
    /// A file or folder could not be read or written.
    #[error("cannot {action}: {source} ({path})")]
    Io {
        /// Action that was tried, in words.
        action: &'static str,
        /// File or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file is not what it should be; baking it again replaces it.
    #[error("damaged dump file: {reason}; bake it again or restore it from a copy ({path})")]
    Damaged {
        /// File.
        path: PathBuf,
        /// Fault of the file, in words.
        reason: String,
    },
    /// The folder holds a dump of something else.
    #[error(
        "the folder holds another dump ({difference} differs); choose another folder or delete it ({path})"
    )]
    OtherBake {
        /// Folder.
        path: PathBuf,
        /// The first field that differs.
        difference: &'static str,
    },
    /// The folder holds a dump already and `create` was asked for.
    #[error("the folder holds a dump already; resume it or choose another folder ({path})")]
    Exists {
        /// Folder.
        path: PathBuf,
    },
    /// Samples that cannot be stored: a fault of the caller.
    #[error("cannot store tile {tile}, pass {pass}: {reason}")]
    Samples {
        /// Tile number.
        tile: usize,
        /// Pass number.
        pass: usize,
        /// Fault of the shard, in words.
        reason: String,
    },
    /// A manifest whose values contradict each other.
    #[error("invalid dump description: {0}")]
    Manifest(String),
}

impl DumpError {
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    pub(crate) fn damaged(path: &Path, reason: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), reason: reason.into() }
    }
}
