//! Names of the files of a bake folder.

use relume_proxy::LightKind;
use std::path::{Path, PathBuf};

/// Lights of the scene ([`crate::files::light_set::LightSet`]).
pub const LIGHTS_FILE: &str = "lights.json";
/// View transform of the scene, unless it is the sRGB curve: a table for
/// [`relume_image::ViewTransform::read_lut`].
pub const VIEW_FILE: &str = "view.png";
/// Lights that the paths are guided towards ([`crate::bake::guiding::GuidingRecord`]).
pub const GUIDED_FILE: &str = "guided.json";
/// Light of another world than the paths were traced with.
pub const WORLD_FILE: &str = "world.exr";
/// Scene that the paths were traced in, for connections ([`crate::device::connections`]).
pub(crate) const SCENE_FILE: &str = "scene.scene";
/// Layers that proxies need to relight without the dump.
pub(crate) const BASE_FILE: &str = "base.exr";
/// List of the files that the folder should hold beside the paths, so that a lost one is noticed.
pub const CONTENTS_FILE: &str = "contents.json";
/// Lock of the process that bakes into the folder.
pub const LOCK_FILE: &str = "baking.lock";
/// Fingerprints of the baked scene, written by the add-on.
pub(crate) const SHOT_FILE: &str = "shot.json";
/// Goal of a bake under way, written by the add-on.
pub(crate) const WANTED_FILE: &str = "wanted.json";

/// File of a proxy in its folder.
pub fn proxy_path(folder: &Path, kind: LightKind) -> PathBuf {
    folder.join(format!("proxy_{kind}.safetensors"))
}

/// File with the measured error beside a proxy.
pub(crate) fn measured_path(folder: &Path, kind: LightKind) -> PathBuf {
    folder.join(format!("proxy_{kind}.json"))
}

/// File with the state of an unfinished or finished training.
pub(crate) fn training_path(folder: &Path, kind: LightKind) -> PathBuf {
    folder.join(format!("training_{kind}.safetensors"))
}
