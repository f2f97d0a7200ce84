//! Lists of shots in JSON, as Blender's panel and its command line write them.
//!
//! ```json
//! { "format": "relume-shots", "version": 1, "shots": [
//!   { "name": "Wide", "bake": "shot_Scene_Wide", "camera": "Camera", "frame": 12, "layer": "ViewLayer",
//!     "size": [1920, 1080], "source": "../shot.blend" } ] }
//! ```
//!
//! Bakes are relative to the file.

use crate::error::SessionError;
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

const FORMAT: &str = "relume-shots";
const VERSION: u32 = 1;
/// Most shots of a list.
const MOST: usize = 10_000;
/// Most bytes of a file.
const MOST_BYTES: u64 = 1 << 24;
/// Most letters of a name.
const LONGEST_NAME: usize = 200;

/// A list of shots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShotList {
    /// The shots, in the artist's order.
    pub shots: Vec<ListedShot>,
}

/// A shot of a list.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ListedShot {
    /// Name by the artist, which no other shot of the list has.
    pub name: String,
    /// Bake folder. Relative to the list in the file, and to the working directory once it is read.
    pub bake: PathBuf,
    /// Camera object of the scene.
    #[serde(default)]
    pub camera: String,
    /// Frame that was baked; none if the list does not say.
    #[serde(default)]
    pub frame: Option<i32>,
    /// View layer; empty for the one that Blender renders first.
    #[serde(default)]
    pub layer: String,
    /// Width and height, pixels.
    #[serde(default)]
    pub size: Option<[u32; 2]>,
    /// The .blend file, relative to the list.
    #[serde(default)]
    pub source: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: u32,
    shots: Vec<ListedShot>,
}

impl ShotList {
    /// Reads a list.
    ///
    /// # Errors
    /// [`SessionError::Shots`] names the file, the shot and the fault.
    pub fn read(path: &Path) -> Result<Self, SessionError> {
        let fail = |reason: String| SessionError::Shots { path: path.to_path_buf(), reason };
        let size = std::fs::metadata(path).map_err(|error| fail(error.to_string()))?.len();
        if size > MOST_BYTES {
            return Err(fail(format!("it has {size} bytes, which is too large for a list of shots")));
        }
        let text = std::fs::read_to_string(path).map_err(|error| fail(error.to_string()))?;
        let mut list = Self::parse(&text).map_err(fail)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        list.shots.iter_mut().for_each(|shot| shot.bake = folder.join(&shot.bake));
        Ok(list)
    }

    /// Parses the text of a list; bakes stay relative.
    ///
    /// # Errors
    /// Names the shot and the fault.
    pub fn parse(text: &str) -> Result<Self, String> {
        let file: File = serde_json::from_str(text).map_err(|error| error.to_string())?;
        if file.format != FORMAT || file.version != VERSION {
            return Err(format!(
                "it says {} version {}, expected {FORMAT} {VERSION}",
                file.format, file.version
            ));
        }
        if file.shots.is_empty() {
            return Err("it lists no shot".into());
        }
        if file.shots.len() > MOST {
            return Err(format!("it lists more than {MOST} shots"));
        }
        let (mut names, mut bakes) = (HashSet::new(), HashSet::new());
        for (number, shot) in file.shots.iter().enumerate() {
            shot.check().map_err(|reason| format!("shot {}: {reason}", number + 1))?;
            if !names.insert(&shot.name) {
                return Err(format!("two shots have the name '{}'", shot.name));
            }
            if !bakes.insert(&shot.bake) {
                let folder = shot.bake.display();
                return Err(format!("two shots have the folder {folder}, the second is '{}'", shot.name));
            }
        }
        Ok(Self { shots: file.shots })
    }

    /// Names for the files of the shots, in their order: what every file system takes, and none twice.
    pub fn file_names(&self) -> Vec<String> {
        let mut taken = HashSet::new();
        let names = self.shots.iter().map(|shot| {
            let plain = file_name(&shot.name);
            let numbered = (2..).map(|number| format!("{plain}_{number}"));
            let mut free = std::iter::once(plain.clone()).chain(numbered);
            free.find(|name| taken.insert(name.to_lowercase())).unwrap_or(plain)
        });
        names.collect()
    }
}

impl ListedShot {
    fn check(&self) -> Result<(), String> {
        let is_line =
            |text: &str| !text.chars().any(char::is_control) && text.chars().count() <= LONGEST_NAME;
        if self.name.trim().is_empty() || !is_line(&self.name) {
            return Err(format!("its name must be a line of 1 to {LONGEST_NAME} letters"));
        }
        let named = |reason: &str| format!("'{}': {reason}", self.name);
        if !is_line(&self.camera) || !is_line(&self.layer) {
            return Err(named(&format!("camera and layer are lines of at most {LONGEST_NAME} letters")));
        }
        if self.bake.as_os_str().is_empty() {
            return Err(named("it names no bake folder"));
        }
        if self.bake.to_string_lossy().contains('\0') {
            return Err(named("its bake is no folder"));
        }
        if self.size.is_some_and(|size| size.contains(&0)) {
            return Err(named("its size has no pixels"));
        }
        Ok(())
    }
}

/// Letters, digits and a few signs, as the add-on writes names of folders; others become `_`.
fn file_name(text: &str) -> String {
    let mut name = String::new();
    for letter in text.chars() {
        let is_plain = letter.is_alphanumeric() || "_-.".contains(letter);
        if is_plain || !name.ends_with('_') {
            name.push(if is_plain { letter } else { '_' });
        }
    }
    let name = name.trim_matches(['.', '_']);
    if name.is_empty() { "shot".into() } else { name.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(shots: &str) -> Result<ShotList, String> {
        ShotList::parse(&format!(r#"{{"format": "relume-shots", "version": 1, "shots": [{shots}]}}"#))
    }

    #[test]
    fn bakes_are_found_from_the_folder_of_the_list() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("shots.json");
        let text = r#"{"format": "relume-shots", "version": 1, "shots": [
            {"name": "Wide", "bake": "wide", "camera": "Camera.001", "frame": -3, "layer": "", "size": [64, 48], "source": "a.blend"},
            {"name": "Close", "bake": "sub/close"}]}"#;
        std::fs::write(&path, text).unwrap();
        let list = ShotList::read(&path).unwrap();
        assert_eq!(list.shots[0].bake, folder.path().join("wide"));
        assert_eq!((list.shots[0].frame, list.shots[0].size), (Some(-3), Some([64, 48])));
        assert_eq!(list.shots[1].bake, folder.path().join("sub").join("close"));
        let missing = ShotList::read(&folder.path().join("none.json")).unwrap_err().to_string();
        assert!(missing.contains("none.json"), "{missing}");
    }

    #[test]
    fn faults_are_named() {
        let fault = |shots: &str| list(shots).unwrap_err();
        assert!(fault("").contains("no shot"));
        assert!(fault(r#"{"name": " ", "bake": "a"}"#).contains("shot 1: its name"));
        assert!(fault(r#"{"name": "A\nB", "bake": "a"}"#).contains("shot 1: its name"));
        assert!(fault(r#"{"name": "A", "bake": ""}"#).contains("'A': it names no bake"));
        assert!(fault(r#"{"name": "A", "bake": "a", "size": [0, 3]}"#).contains("no pixels"));
        assert!(fault(r#"{"name": "A", "bake": "a", "siez": [1, 3]}"#).contains("siez"));
        let twice = fault(r#"{"name": "A", "bake": "a"}, {"name": "A", "bake": "b"}"#);
        assert!(twice.contains("the name 'A'"), "{twice}");
        let shared = fault(r#"{"name": "A", "bake": "a"}, {"name": "B", "bake": "a"}"#);
        assert!(shared.contains("folder a") && shared.contains("'B'"), "{shared}");
        assert!(ShotList::parse(r#"{"format": "relume-shots", "version": 2, "shots": []}"#).is_err());
        assert!(ShotList::parse("[]").is_err());
        let many = vec![r#"{"name": "A", "bake": "a"}"#; MOST + 1].join(",");
        assert!(fault(&many).contains("more than"));
    }

    #[test]
    fn names_of_files_leave_no_folder_and_none_is_given_twice() {
        let named = ["a/b", "a_b", "A:B", "../..", "..", "C.001", "Küche"];
        let shots: Vec<String> = named
            .iter()
            .enumerate()
            .map(|(number, name)| format!(r#"{{"name": "{name}", "bake": "{number}"}}"#))
            .collect();
        let names = list(&shots.join(",")).unwrap().file_names();
        assert_eq!(names, ["a_b", "a_b_2", "A_B_3", "shot", "shot_2", "C.001", "Küche"]);
    }
}
