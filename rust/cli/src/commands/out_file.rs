use anyhow::bail;
use std::path::Path;

/// Stands for the name of a shot in the names of files.
pub const SHOT: &str = "{shot}";

/// Refuses, before the work, a file of another format than this command writes, or in no folder. `what` is a sentence
/// such as "pictures are written as a multi-layer EXR".
pub fn check_out(path: &Path, extension: &str, what: &str) -> anyhow::Result<()> {
    let shown = path.display();
    if path.is_dir() {
        bail!(
            "{shown} is a folder; name a file in it, such as {}",
            path.join("shot").with_extension(extension).display()
        );
    }
    if !path.extension().is_some_and(|found| found.eq_ignore_ascii_case(extension)) {
        bail!("cannot write {shown}: {what}; let the name end in .{extension}");
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if folder.is_some_and(|folder| !folder.is_dir()) {
        bail!("cannot write {shown}: its folder does not exist; make it first");
    }
    Ok(())
}
