use crate::error::SessionError;
use crate::files::names::LOCK_FILE;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// A bake folder that no other process bakes into meanwhile.
pub(crate) struct FolderLock {
    path: PathBuf,
    _file: File,
}

impl FolderLock {
    /// Takes a folder, which is made if it is not there. Work of the same process that is about to end does not count.
    /// Nor do locks on file systems without them.
    ///
    /// # Errors
    /// If another process has it.
    pub fn take(folder: &Path) -> Result<Self, SessionError> {
        if folder.is_file() {
            let reason = format!("{} is a file; choose another name for the bake folder", folder.display());
            return Err(SessionError::Settings(reason));
        }
        std::fs::create_dir_all(folder).map_err(SessionError::io("create the folder", folder))?;
        let path = folder.join(LOCK_FILE);
        let mut file = open(&path, true).map_err(SessionError::io("write", &path))?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => other_process(&file).map_or(Ok(()), Err),
            _ => Ok(()),
        }
        .map_err(|process| SessionError::Settings(words(folder, &process)))?;
        // Whoever cannot read it is not told which process it is.
        let _ = file.set_len(0).and_then(|()| write!(file, "{}", std::process::id()));
        Ok(Self { path, _file: file })
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

/// Message about another process that bakes into a folder.
pub fn folder_in_use(folder: &Path) -> Option<String> {
    let file = open(&folder.join(LOCK_FILE), false).ok()?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Some(words(folder, &other_process(&file)?)),
        _ => None,
    }
}

fn open(path: &Path, create: bool) -> std::io::Result<File> {
    OpenOptions::new().read(true).write(true).create(create).truncate(false).open(path)
}

/// The process that a lock file names, if it is not this one; without a number where it cannot be read.
fn other_process(mut file: &File) -> Option<String> {
    let mut text = String::new();
    let read = file.read_to_string(&mut text).ok().and_then(|_| text.trim().parse::<u32>().ok());
    match read {
        Some(number) if number == std::process::id() => None,
        Some(number) => Some(format!("another process ({number})")),
        None => Some("another process".into()),
    }
}

fn words(folder: &Path, process: &str) -> String {
    format!(
        "{process} is baking into {}; wait for its end, stop it, or choose another folder",
        folder.display()
    )
}
