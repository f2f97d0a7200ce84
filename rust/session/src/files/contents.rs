use crate::error::SessionError;
use crate::files::checksum::{self, crc32};
use crate::files::names::{CONTENTS_FILE, GUIDED_FILE, LIGHTS_FILE, measured_path, proxy_path};
use relume_dump::Manifest;
use relume_image::write_atomically;
use relume_proxy::LightKind;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};

const FORMAT: &str = "relume-contents";
const VERSION: u32 = 1;

#[derive(Serialize, Deserialize)]
struct Contents {
    format: String,
    version: u32,
    /// Names.
    files: BTreeSet<String>,
    /// CRC-32 of those files that hold none of their own, by name.
    #[serde(default)]
    sums: BTreeMap<String, String>,
    /// Checksum of this file ([`checksum::with_own`]).
    #[serde(default)]
    checksum: String,
}

impl Contents {
    fn none() -> Self {
        let (files, sums) = (BTreeSet::new(), BTreeMap::new());
        Self { format: FORMAT.into(), version: VERSION, files, sums, checksum: String::new() }
    }

    /// Contents of a folder; empty if it has none of this version.
    fn of(folder: &Path) -> Self {
        let text = std::fs::read_to_string(folder.join(CONTENTS_FILE)).unwrap_or_default();
        Self::parse(&text).unwrap_or_else(|_| Self::none())
    }

    fn parse(text: &str) -> Result<Self, String> {
        let contents: Self = serde_json::from_str(text).map_err(|error| error.to_string())?;
        if contents.format != FORMAT || contents.version != VERSION {
            return Err(format!("it says {} version {}", contents.format, contents.version));
        }
        // Those of older bakes have neither.
        if !(contents.sums.is_empty() && contents.checksum.is_empty()) {
            checksum::check_own(text, &contents.checksum)?;
        }
        Ok(contents)
    }

    fn write(&mut self, folder: &Path) -> Result<(), SessionError> {
        let path = folder.join(CONTENTS_FILE);
        self.checksum.clear();
        Ok(write_atomically(&path, |writer| {
            let text = serde_json::to_string_pretty(self)?;
            writer.write_all(checksum::with_own(&text).as_bytes())
        })?)
    }

    fn lacks(&self, path: &Path) -> bool {
        self.files.contains(&name_of(path)) && !path.exists()
    }
}

/// Notes a file that was written, and its checksum if it holds none of its own. A crash in between loses the note, not
/// the file.
pub(crate) fn note(path: &Path) -> Result<(), SessionError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let name = name_of(path);
    let mut contents = Contents::of(folder);
    let mut is_new = contents.files.insert(name.clone());
    if path.extension().is_none_or(|extension| extension != "safetensors") {
        let sum = crc32(&std::fs::read(path).map_err(SessionError::io("read", path))?);
        is_new |= contents.sums.insert(name, sum.clone()).as_ref() != Some(&sum);
    }
    if is_new { contents.write(folder) } else { Ok(()) }
}

/// Notes that a folder need not hold some files any more, which are to be removed after.
pub(crate) fn forget(folder: &Path, paths: &[PathBuf]) -> Result<(), SessionError> {
    let mut contents = Contents::of(folder);
    let before = contents.files.len();
    for name in paths.iter().map(|path| name_of(path)) {
        contents.files.remove(&name);
        contents.sums.remove(&name);
    }
    if contents.files.len() < before { contents.write(folder) } else { Ok(()) }
}

/// Fault of a folder's own list of its files, if it has one.
pub(crate) fn fault(folder: &Path) -> Option<String> {
    let path = folder.join(CONTENTS_FILE);
    if !path.exists() {
        return None;
    }
    let text = std::fs::read_to_string(&path).map_err(|error| error.to_string());
    text.and_then(|text| Contents::parse(&text)).err()
}

/// True if a file differs from what was noted.
pub(crate) fn is_altered(path: &Path) -> bool {
    let contents = Contents::of(path.parent().unwrap_or(Path::new("")));
    let noted = contents.sums.get(&name_of(path));
    noted.is_some_and(|sum| std::fs::read(path).is_ok_and(|bytes| crc32(&bytes) != *sum))
}

/// True if a file is gone that its folder should hold.
pub(crate) fn is_lost(path: &Path) -> bool {
    Contents::of(path.parent().unwrap_or(Path::new(""))).lacks(path)
}

/// Warnings about files that are gone from a folder: what follows, and what to do.
pub fn lost_files(folder: &Path) -> Vec<String> {
    let contents = Contents::of(folder);
    let mut lost = Vec::new();
    if folder.join(Manifest::FILE).exists() {
        lost.extend(
            OF_PATHS.into_iter().filter(|(name, _)| contents.lacks(&folder.join(name))).map(
                |(name, effect)| format!("{name} is missing in {}, {effect} (Rebake)", folder.display()),
            ),
        );
    }
    for kind in LightKind::ALL {
        let files = [proxy_path(folder, kind), measured_path(folder, kind)];
        let names: Vec<String> =
            files.iter().filter(|path| contents.lacks(path)).map(|path| name_of(path)).collect();
        let (are, them) = match names.len() {
            0 => continue,
            1 => ("is", "it"),
            _ => ("are", "them"),
        };
        lost.push(format!(
            "{} {are} missing in {}, so that lights of this type are summed from the samples: restore {them}, or have them \
             learned again (Rebake, or relume train --type {kind})",
            names.join(" and "),
            folder.display()
        ));
    }
    lost
}

/// Files that belong to the paths of a bake, and what follows where they are gone.
const OF_PATHS: [(&str, &str); 2] = [
    (
        LIGHTS_FILE,
        "so that the scene's own lights are not known without its .blend: restore it, or bake again",
    ),
    (
        GUIDED_FILE,
        "so that lights may be said to be met by few paths that are met by many: restore it, or trace anew",
    ),
];

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(path: &Path) {
        std::fs::write(path, "something").unwrap();
    }

    #[test]
    fn what_was_noted_and_is_gone_is_missed() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let [proxy, measured] = [proxy_path(folder, LightKind::Quad), measured_path(folder, LightKind::Quad)];
        write(&proxy);
        note(&proxy).unwrap();
        write(&measured);
        note(&measured).unwrap();
        std::fs::remove_file(&measured).unwrap();
        let lost = lost_files(folder);
        assert_eq!(lost.len(), 1, "{lost:?}");
        let place = folder.display();
        assert!(lost[0].starts_with(&format!("proxy_quad.json is missing in {place}, so")), "{lost:?}");
        std::fs::remove_file(&proxy).unwrap();
        let both = format!("proxy_quad.safetensors and proxy_quad.json are missing in {place}, so");
        assert!(lost_files(folder)[0].starts_with(&both));
        forget(folder, std::slice::from_ref(&measured)).unwrap();
        assert!(is_lost(&proxy) && !is_lost(&measured));
        write(&proxy);
        assert_eq!(lost_files(folder), [""; 0]);
    }

    #[test]
    fn files_of_paths_are_missed_where_there_are_paths() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        for name in [GUIDED_FILE, "another.json"] {
            write(&folder.join(name));
            note(&folder.join(name)).unwrap();
            std::fs::remove_file(folder.join(name)).unwrap();
        }
        assert_eq!(lost_files(folder), [""; 0], "a folder of proxies has none");
        write(&folder.join(Manifest::FILE));
        let lost = lost_files(folder);
        assert!(lost.len() == 1 && lost[0].starts_with(GUIDED_FILE), "{lost:?}");
    }

    #[test]
    fn a_folder_that_does_not_say_what_it_holds_lacks_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        write(&folder.join(Manifest::FILE));
        assert_eq!(lost_files(folder), [""; 0]);
        for text in ["", "{}", r#"{"format": "relume-contents", "version": 2, "files": ["guided.json"]}"#] {
            std::fs::write(folder.join(CONTENTS_FILE), text).unwrap();
            assert_eq!(lost_files(folder), [""; 0], "{text}");
        }
    }
}
