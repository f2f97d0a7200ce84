//! Light of another world than the one that the paths of a bake were traced with. Paths are right for any world; only
//! their own layer `world` belongs to one.

use crate::error::SessionError;
use crate::files::checksum::crc32;
use crate::files::names::WORLD_FILE;
use relume_dump::{Aovs, Dump, Manifest};
use relume_image::{Image, Layer, LayeredImage, Precision, read_exr, write_exr};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

const LAYER: &str = "world";
/// Draw of the error of that layer; missing if it is not known.
const ERROR: &str = "error";
/// Attribute of the file, JSON of [`WorldAbout`].
const ABOUT: &str = "relume";

/// Identity of the world that a layer shows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WorldAbout {
    /// [`relume_scene::Scene::world_map`].
    pub map: String,
    /// Radiance of the world, or the factor on its texture; RGB.
    pub color: [f32; 3],
}

/// Header of a stored world.
#[derive(Serialize, Deserialize)]
struct Stored {
    about: WorldAbout,
    /// [`Manifest::bake_id`].
    bake: String,
    /// Paths per pixel behind it.
    samples: u32,
    /// [`crc32`] of the pixels; empty in older files.
    #[serde(default)]
    checksum: String,
}

/// The light of a world, gathered from paths of a bake.
#[derive(Clone, Debug)]
pub(crate) struct WorldLayer {
    pub about: WorldAbout,
    pub samples: u32,
    pub image: Image,
    /// A draw of its error; no pixels where that is not known.
    pub error: Image,
}

impl WorldLayer {
    /// Layer of a bake folder whose paths are these; none if their own world is shown.
    ///
    /// # Errors
    /// If the file is damaged.
    pub fn of_bake(folder: &Path, manifest: &Manifest) -> Result<Option<Self>, SessionError> {
        let path = folder.join(WORLD_FILE);
        if !path.exists() {
            return Ok(None);
        }
        let mut file = read_exr(&path)?;
        let damaged = || SessionError::Settings(format!("{} is damaged; delete it", path.display()));
        let stored = file.attributes.get(ABOUT).and_then(|json| serde_json::from_str(json).ok());
        let Stored { about, bake, samples, checksum } = stored.ok_or_else(damaged)?;
        if bake != manifest.bake_id() {
            return Ok(None);
        }
        let shape = (manifest.width, manifest.height, 3);
        let mut take = |name: &str| {
            let layer = file.layers.iter_mut().find(|layer| layer.name == name)?;
            let image = std::mem::take(&mut layer.image);
            Some(image).filter(|image| (image.width, image.height, image.channels) == shape)
        };
        let image = take(LAYER).ok_or_else(damaged)?;
        let error = take(ERROR).unwrap_or_default();
        if !checksum.is_empty() && checksum != checksum_of(&image, &error) {
            return Err(damaged());
        }
        Ok(Some(Self { about, samples, image, error }))
    }

    /// Writes it into the bake's folder, whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, folder: &Path, manifest: &Manifest) -> Result<(), SessionError> {
        let (about, bake, samples) = (self.about.clone(), manifest.bake_id(), self.samples);
        let checksum = checksum_of(&self.image, &self.error);
        let stored = serde_json::to_string(&Stored { about, bake, samples, checksum })
            .map_err(|error| SessionError::Settings(format!("the world cannot be stored: {error}")))?;
        let mut layers = vec![Layer::color(LAYER, self.image.clone())];
        if !self.error.data.is_empty() {
            layers.push(Layer::color(ERROR, self.error.clone()));
        }
        let (width, height) = (self.image.width, self.image.height);
        let attributes = BTreeMap::from([(ABOUT.to_string(), stored)]);
        let file = LayeredImage { width, height, layers, attributes };
        Ok(write_exr(&folder.join(WORLD_FILE), &file, Precision::Float)?)
    }
}

fn checksum_of(image: &Image, error: &Image) -> String {
    [image, error].map(|image| crc32(bytemuck::cast_slice(&image.data))).concat()
}

/// Means over a bake's paths, under their own world or another one, and which one that is.
pub(crate) fn aovs_of(dump: &Dump, world: Option<WorldLayer>) -> (Aovs, WorldAbout) {
    let aovs = dump.aovs();
    match world {
        Some(layer) => (Aovs { world: layer.image, ..aovs }, layer.about),
        None => (aovs, own_world(dump.manifest())),
    }
}

/// The world that the paths of a bake were traced with.
pub(crate) fn own_world(manifest: &Manifest) -> WorldAbout {
    WorldAbout { map: manifest.world_map.clone(), color: manifest.world_color }
}

/// Removes the light of another world from a folder, if it holds one.
///
/// # Errors
/// If the file cannot be removed.
pub(crate) fn forget(folder: &Path) -> Result<(), SessionError> {
    let path = folder.join(WORLD_FILE);
    match std::fs::remove_file(&path) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(SessionError::io("remove the light of another world", &path)(error))
        }
        _ => Ok(()),
    }
}
