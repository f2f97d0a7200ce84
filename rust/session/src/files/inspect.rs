use crate::error::SessionError;
use crate::files::contents::lost_files;
use crate::files::damage::{self, reason_of};
use crate::files::light_set::LightSet;
use crate::files::names::LIGHTS_FILE;
use crate::files::proxies::{Measured, Proxies};
use crate::files::scene_file::SceneFile;
use relume_dump::{Dump, Manifest};
use relume_proxy::{Proxy, ProxyInfo};
use relume_scene::Instance;
use serde::Serialize;
use std::path::Path;

/// Description of a file or folder.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Info {
    /// A bake folder.
    Bake {
        /// Manifest of the bake.
        manifest: Box<Manifest>,
        /// Tiles and passes that are there, of all.
        shards: [usize; 2],
        /// Records of all shards.
        records: usize,
        /// Bytes of all shards.
        bytes: u64,
        /// Names of the scene's lights.
        lights: Vec<String>,
        /// Proxies in the folder.
        proxies: Vec<ProxySummary>,
        /// Files that are gone ([`lost_files`]) or cannot be read, in words.
        lost: Vec<String>,
    },
    /// A folder of proxies without their bake.
    Proxies {
        /// The proxies.
        proxies: Vec<ProxySummary>,
        /// Files that are gone ([`lost_files`]) or cannot be read, in words.
        lost: Vec<String>,
    },
    /// A proxy.
    Proxy {
        /// Facts about it.
        info: Box<ProxyInfo>,
    },
    /// A light set.
    Lights {
        /// Name of the set.
        name: String,
        /// Lights of the set.
        lights: Vec<relume_scene::Light>,
        /// Changes made on reading.
        notes: Vec<String>,
    },
    /// A scene file.
    Scene {
        /// Hash of the scene, as in the manifest of its bake.
        scene_hash: String,
        /// Width and height of its picture, pixels.
        resolution: [usize; 2],
        /// Paths per pixel, if not told otherwise.
        samples: u32,
        /// Meshes placed.
        instances: usize,
        /// Their triangles.
        triangles: usize,
        /// Names of its lights.
        lights: Vec<String>,
        /// Warnings about things that cannot be represented.
        warnings: Vec<String>,
    },
}

/// A proxy of a folder.
#[derive(Clone, Debug, Serialize)]
pub struct ProxySummary {
    /// Facts about it.
    pub info: ProxyInfo,
    /// Comparison with gathering.
    pub measured: Option<Measured>,
}

/// Describes a bake folder, proxy, light set or scene file.
///
/// # Errors
/// If it is none of these, or damaged.
pub fn info(path: &Path) -> Result<Info, SessionError> {
    if path.is_dir() {
        return if path.join(Manifest::FILE).exists() { bake_info(path) } else { proxies_info(path) };
    }
    match extension(path).as_str() {
        "json" => {
            let LightSet { name, lights, notes } = LightSet::read(path)?;
            Ok(Info::Lights { name, lights, notes })
        }
        "safetensors" => Ok(Info::Proxy { info: Box::new(Proxy::open(path)?.info().clone()) }),
        "scene" => Ok(scene_info(SceneFile::read(path)?)),
        _ => Err(unknown(path)),
    }
}

fn scene_info(SceneFile { scene, settings, .. }: SceneFile) -> Info {
    let triangles =
        |instance: &Instance| scene.mesh(instance.geometry).map_or(0, |mesh| mesh.triangles.len());
    Info::Scene {
        scene_hash: scene.hash(),
        resolution: [scene.camera.width, scene.camera.height],
        samples: settings.samples,
        instances: scene.instances.len(),
        triangles: scene.instances.iter().map(triangles).sum(),
        lights: scene.lights.into_iter().map(|light| light.name).collect(),
        warnings: scene.warnings,
    }
}

fn bake_info(folder: &Path) -> Result<Info, SessionError> {
    let dump = Dump::open(folder)?;
    let manifest = dump.manifest();
    let all = manifest.tile_count() * manifest.passes.len();
    let mut lost = lost_files(folder);
    let lights = LightSet::of_bake(folder).unwrap_or_else(|error| {
        lost.push(damage::damage_message(&folder.join(LIGHTS_FILE), &reason_of(error)));
        LightSet::default()
    });
    let (proxies, unusable) = Proxies::open_usable(folder, &manifest.scene_hash);
    lost.extend(unusable);
    Ok(Info::Bake {
        shards: [all - dump.missing().len(), all],
        records: dump.record_count(),
        bytes: dump.shards().map(|shard| shard.as_bytes().len() as u64).sum(),
        lights: lights.lights.into_iter().map(|light| light.name).collect(),
        proxies: summaries(&proxies),
        lost,
        manifest: Box::new(manifest.clone()),
    })
}

fn proxies_info(folder: &Path) -> Result<Info, SessionError> {
    let base = crate::files::base_layers::read(folder)?;
    let (proxies, unusable) = Proxies::open_usable(folder, &base.scene_hash);
    let lost = lost_files(folder).into_iter().chain(unusable).collect();
    Ok(Info::Proxies { proxies: summaries(&proxies), lost })
}

fn summaries(proxies: &Proxies) -> Vec<ProxySummary> {
    let summary = |p: &crate::files::proxies::TrainedProxy| ProxySummary {
        info: p.proxy.info().clone(),
        measured: p.measured,
    };
    proxies.iter().map(summary).collect()
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn unknown(path: &Path) -> SessionError {
    let reason =
        if path.exists() { "is no bake folder, proxy, light set or scene file" } else { "does not exist" };
    SessionError::Settings(format!("{} {reason}", path.display()))
}
