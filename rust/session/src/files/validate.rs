//! Finds all that is wrong with a bake folder, proxy, light set or scene file.

use crate::bake::guiding::GuidingRecord;
use crate::bake::world::WorldLayer;
use crate::error::SessionError;
use crate::files::base_layers;
use crate::files::contents::{self, lost_files};
use crate::files::damage::{damage_message, reason_of};
use crate::files::inspect::info;
use crate::files::light_set::LightSet;
use crate::files::names::{
    BASE_FILE, CONTENTS_FILE, GUIDED_FILE, LIGHTS_FILE, SCENE_FILE, SHOT_FILE, VIEW_FILE, WANTED_FILE,
    WORLD_FILE, measured_path, proxy_path, training_path,
};
use crate::files::proxies::{TrainedProxy, read_measured};
use crate::files::scene_file::SceneFile;
use crate::files::shot_files::{check_shot, check_wanted};
use crate::progress::{Monitor, Stage};
use relume_dump::{Dump, Manifest};
use relume_image::ViewTransform;
use relume_proxy::{LightKind, read_info};
use std::path::Path;

/// Faults of a bake folder, proxy, light set or scene file, all of which is read.
///
/// # Errors
/// If it is none of these.
pub fn validate(path: &Path, monitor: &Monitor) -> Result<Vec<String>, SessionError> {
    let stage = monitor.stage(Stage::Validate, 0, 1);
    let is_bake = path.join(Manifest::FILE).exists();
    let problems = if is_bake || path.join(BASE_FILE).exists() {
        let manifest = if is_bake { Manifest::read(path).ok() } else { None };
        let paths = if is_bake { faults_of_paths(path, manifest.as_ref()) } else { Vec::new() };
        let hash = scene_hash(path, manifest.as_ref());
        let proxies =
            LightKind::ALL.into_iter().flat_map(|kind| faults_of_proxy(path, kind, hash.as_deref()));
        [paths, lost_files(path), faults_of_files(path, manifest.as_ref()), proxies.collect()].concat()
    } else {
        // Single files are checked whole by their readers.
        match info(path) {
            Err(error) if path.is_dir() || !path.exists() => return Err(error),
            found => found.err().map(|error| error.to_string()).into_iter().collect(),
        }
    };
    stage.advance(1, "");
    Ok(problems)
}

/// Scene hash that the proxies of a folder should have.
fn scene_hash(folder: &Path, manifest: Option<&Manifest>) -> Option<String> {
    let of_base = || base_layers::read(folder).ok().map(|base| base.scene_hash);
    manifest.map(|manifest| manifest.scene_hash.clone()).or_else(of_base)
}

/// Faults of the manifest and the shards.
fn faults_of_paths(folder: &Path, manifest: Option<&Manifest>) -> Vec<String> {
    let path = folder.join(Manifest::FILE);
    let altered = (manifest.is_some() && contents::is_altered(&path)).then(|| damage_message(&path, ALTERED));
    let faults = Dump::validate_dir(folder).unwrap_or_else(|error| vec![error.to_string()]);
    altered.into_iter().chain(faults).collect()
}

const ALTERED: &str = "it is not as Relume wrote it";

/// Refuses a file that cannot be read.
type FileCheck<'a> = dyn Fn(&Path) -> Result<(), String> + 'a;

/// Faults of the small files beside the paths.
pub(crate) fn faults_of_files(folder: &Path, manifest: Option<&Manifest>) -> Vec<String> {
    let whole = |result: Result<(), SessionError>| result.map_err(reason_of);
    let world = || manifest.map_or(Ok(()), |manifest| WorldLayer::of_bake(folder, manifest).map(drop));
    let view = |path: &Path| ViewTransform::read_lut(path).map(drop).map_err(|error| error.to_string());
    let files: [(&str, &FileCheck); 9] = [
        (CONTENTS_FILE, &|_| contents::fault(folder).map_or(Ok(()), Err)),
        (LIGHTS_FILE, &|path| whole(LightSet::read(path).map(drop))),
        (GUIDED_FILE, &|_| whole(GuidingRecord::of_bake(folder).map(drop))),
        (VIEW_FILE, &view),
        (WORLD_FILE, &|_| whole(world())),
        (SCENE_FILE, &|path| whole(SceneFile::read(path).map(drop))),
        (BASE_FILE, &|_| whole(base_layers::read(folder).map(drop))),
        (SHOT_FILE, &check_shot),
        (WANTED_FILE, &check_wanted),
    ];
    files.iter().filter_map(|(name, check)| fault_of_file(&folder.join(name), check)).collect()
}

fn fault_of_file(path: &Path, check: &FileCheck) -> Option<String> {
    if !path.exists() {
        return None;
    }
    let altered = || contents::is_altered(path).then(|| ALTERED.to_string());
    check(path).err().or_else(altered).map(|reason| damage_message(path, &reason))
}

/// Faults of a proxy, its measurement, and its training.
fn faults_of_proxy(folder: &Path, kind: LightKind, scene_hash: Option<&str>) -> Vec<String> {
    let (proxy, training) = (proxy_path(folder, kind), training_path(folder, kind));
    let hash = match (scene_hash, read_info(&proxy)) {
        (Some(hash), _) => hash.to_string(),
        (None, found) => found.map(|info| info.scene_hash).unwrap_or_default(),
    };
    let measured = measured_path(folder, kind);
    let of_proxy = TrainedProxy::open(folder, kind, &hash).err().map(|error| error.to_string());
    let of_measured = fault_of_file(&measured, &|path| read_measured(path).map(drop));
    let of_training = training.exists().then(|| read_info(&training).err()).flatten();
    let of_training = of_training.map(|error| error.to_string());
    of_proxy.into_iter().chain(of_measured).chain(of_training).collect()
}
