//! Words for damaged files of a bake folder: what follows, and what to do.

use crate::error::SessionError;
use crate::files::names::{
    BASE_FILE, CONTENTS_FILE, GUIDED_FILE, LIGHTS_FILE, SCENE_FILE, SHOT_FILE, VIEW_FILE, WANTED_FILE,
    WORLD_FILE,
};
use relume_dump::Manifest;
use std::path::Path;

/// Message about a damaged file of a folder.
pub(crate) fn damage_message(path: &Path, reason: &str) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let effect = EFFECTS.iter().find(|(file, _)| *file == name).map_or(OF_PROXIES, |(_, effect)| effect);
    format!("{} is damaged ({}), {effect}", path.display(), reason.trim_end_matches('.'))
}

/// The reason of an error without the file that it names besides.
pub(crate) fn reason_of(error: SessionError) -> String {
    match error {
        SessionError::Lights { reason, .. } | SessionError::SceneFile { reason, .. } => reason,
        other => other.to_string(),
    }
}

const OF_PROXIES: &str = "so that lights of this type are summed from the samples: have them learned again";

const EFFECTS: [(&str, &str); 10] = [
    (Manifest::FILE, "so that nothing can be made of the bake: restore it, or bake again"),
    (
        LIGHTS_FILE,
        "so that the scene's own lights are not known without its .blend: restore it, or bake again",
    ),
    (
        GUIDED_FILE,
        "so that lights may be said to be met by few paths that are met by many: restore it, or trace anew",
    ),
    (VIEW_FILE, "so that PNGs have the sRGB curve instead of the scene's view: restore it, or bake again"),
    (WORLD_FILE, "so that the world is shown that the paths were traced with: delete it"),
    (SCENE_FILE, "so that lights have more noise, small ones above all: delete it, and go on with the bake"),
    (BASE_FILE, "so that proxies do not work without their bake: restore it, or train again"),
    (CONTENTS_FILE, "so that files that are missing or altered are not noticed: restore it, or delete it"),
    (SHOT_FILE, "so that what has changed in the scene since is not noticed: restore it, or bake again"),
    (WANTED_FILE, "so that a bake that was stopped is not offered to go on: delete it"),
];
