use crate::ImageError;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// [`replace_file`] with an error that names the file.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), ImageError> {
    replace_file(path, write).map_err(|source| ImageError::Write { path: path.to_path_buf(), source })
}

/// Writes a file so that a reader never sees half of it: into a temporary file of the same folder, flushed to
/// disk, then renamed. On any error the temporary file is removed and an older file at `path` stays as it was.
pub fn replace_file(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".relume-").suffix(".part");
    // The default of 0600 would hide the result from the other users of a shared folder; the umask still applies.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let temporary = builder.tempfile_in(folder)?;
    let mut writer = BufWriter::new(temporary.as_file().try_clone()?);
    write(&mut writer)?;
    writer.flush()?;
    temporary.as_file().sync_all()?;
    temporary.persist(path).map_err(|error| error.error)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_write_keeps_the_old_file_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.exr");
        std::fs::write(&path, b"old").unwrap();
        let result = write_atomically(&path, |w| {
            w.write_all(b"half of the new")?;
            Err(io::Error::other("disk full"))
        });
        let message = result.unwrap_err().to_string();
        assert!(message.contains("disk full") && message.contains("image.exr"), "{message}");
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn missing_folder_is_an_error_that_names_the_file() {
        let message =
            write_atomically(Path::new("no/such/folder/x.png"), |_| Ok(())).unwrap_err().to_string();
        assert!(message.contains("no/such/folder/x.png"), "{message}");
    }
}
