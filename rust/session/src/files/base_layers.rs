//! Layers beside the proxies of a folder, which relight without the dump: AOVs, static light, camera.

use crate::error::SessionError;
use crate::files::contents;
use crate::files::names::BASE_FILE;
use relume_dump::Aovs;
use relume_image::{Image, Layer, LayeredImage, Precision, read_exr, write_exr};
use relume_scene::Camera;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Attribute of the file, JSON of [`BaseHeader`]; a single one, so that equal layers are equal files.
const ABOUT: &str = "relume";

#[derive(Serialize, Deserialize)]
struct BaseHeader {
    scene_hash: String,
    camera: Camera,
}

pub(crate) struct BaseLayers {
    pub(crate) aovs: Aovs,
    pub(crate) camera: Camera,
    pub(crate) scene_hash: String,
}

/// Writes them into a folder, atomically.
pub(crate) fn write(
    folder: &Path,
    aovs: &Aovs,
    camera: &Camera,
    scene_hash: &str,
) -> Result<(), SessionError> {
    let about = BaseHeader { scene_hash: scene_hash.to_string(), camera: camera.clone() };
    let about = serde_json::to_string(&about)
        .map_err(|error| SessionError::Settings(format!("the camera cannot be stored: {error}")))?;
    let layers = vec![
        Layer::color("albedo", aovs.albedo.clone()),
        Layer::vector("normal", aovs.normal.clone()),
        Layer::depth("depth", aovs.depth.clone()),
        Layer::color("static", aovs.emission.clone()),
        Layer::color("world", aovs.world.clone()),
        Layer::color("alpha", aovs.alpha.clone()),
    ];
    let attributes = BTreeMap::from([(ABOUT.to_string(), about)]);
    let image = LayeredImage { width: aovs.depth.width, height: aovs.depth.height, layers, attributes };
    let path = folder.join(BASE_FILE);
    write_exr(&path, &image, Precision::Float)?;
    contents::note(&path)
}

/// Reads them back.
pub(crate) fn read(folder: &Path) -> Result<BaseLayers, SessionError> {
    let path = folder.join(BASE_FILE);
    if !path.exists() {
        let shown = folder.display();
        let reason = match folder.is_dir() {
            true => format!("{shown} holds neither a bake nor proxies; bake or train first"),
            false => format!("there is no folder {shown}; bake into it first"),
        };
        return Err(SessionError::Settings(reason));
    }
    let mut file = read_exr(&path)?;
    let damaged = |what: &str| {
        SessionError::Settings(format!("{} has no usable {what}; train again from the bake", path.display()))
    };
    let mut take = |name: &str, channels: usize| -> Result<Image, SessionError> {
        let layer =
            file.layers.iter_mut().find(|layer| layer.name == name && layer.image.channels == channels);
        layer.map(|layer| std::mem::take(&mut layer.image)).ok_or_else(|| damaged(&format!("layer {name}")))
    };
    let aovs = Aovs {
        albedo: take("albedo", 3)?,
        normal: take("normal", 3)?,
        depth: take("depth", 1)?,
        emission: take("static", 3)?,
        world: take("world", 3)?,
        alpha: take("alpha", 1)?,
    };
    let about = file.attributes.get(ABOUT).and_then(|json| serde_json::from_str(json).ok());
    let BaseHeader { scene_hash, camera } = about.ok_or_else(|| damaged("camera"))?;
    Ok(BaseLayers { aovs, camera, scene_hash })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_and_camera_come_back_exactly() {
        let folder = tempfile::tempdir().unwrap();
        let image = |channels: usize, seed: f32| Image {
            data: (0..6 * channels).map(|i| (i as f32 + seed) / 7.0).collect(),
            ..Image::new(3, 2, channels)
        };
        let aovs = Aovs {
            albedo: image(3, 0.1),
            normal: image(3, 0.2),
            depth: image(1, 0.3),
            emission: image(3, 0.4),
            world: image(3, 0.5),
            alpha: image(1, 0.6),
        };
        let camera = Camera { width: 3, height: 2, clip_end: 100.0, ..Camera::default() };
        write(folder.path(), &aovs, &camera, "1234").unwrap();
        let read = read(folder.path()).unwrap();
        assert_eq!((read.camera, read.scene_hash.as_str()), (camera, "1234"));
        for (a, b) in [
            (&read.aovs.albedo, &aovs.albedo),
            (&read.aovs.normal, &aovs.normal),
            (&read.aovs.depth, &aovs.depth),
            (&read.aovs.emission, &aovs.emission),
            (&read.aovs.world, &aovs.world),
            (&read.aovs.alpha, &aovs.alpha),
        ] {
            assert_eq!(a, b);
        }
    }

    #[test]
    fn empty_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let message = read(folder.path()).err().unwrap().to_string();
        assert!(message.contains("neither a bake nor proxies"), "{message}");
    }
}
