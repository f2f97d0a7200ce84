use std::io;
use std::path::PathBuf;

/// Errors of image files. Each message names the file and what to do.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The file could not be created or written; nothing is left at its place.
    #[error("cannot write the file: {source}; check the folder's permissions and free space: {}", path.display())]
    Write {
        /// Path of the file to write.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file could not be opened or read.
    #[error("cannot read the image: {source}: {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file is damaged or of a kind that is not read here.
    #[error("not a usable image: {reason}: {}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Fault of the file, in words.
        reason: String,
    },
}
