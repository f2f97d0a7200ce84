use crate::error::SessionError;
use crate::relight::source::UnitSource;
use relume_gather::LobePart;
use relume_image::{BitDepth, Image, Layer, LayeredImage, Precision, ViewTransform, write_exr, write_png};
use std::collections::{BTreeMap, HashSet};
use std::path::Path;

/// Name of the layer that holds the picture.
const COMBINED: &str = "Combined";

/// One light's picture.
#[derive(Clone, Debug, PartialEq)]
pub struct RelitLight {
    /// Object name.
    pub name: String,
    /// Contribution of the light, scene-linear RGB.
    pub image: Image,
    /// Source of its unit image.
    pub source: UnitSource,
    /// Parts of the image that add up to it, in the order of [`LobePart::ALL`]; empty unless asked for.
    pub lobes: Vec<Image>,
}

/// Names of the channels of an EXR.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExrLayout {
    /// Blender's own: `ViewLayer.Combined.R`.
    #[default]
    Blender,
    /// Names for other programs: `R` of the picture, `Combined_Key.R` of its layers, without spaces.
    Plain,
}

/// A relit picture in layers, all scene-linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Relit {
    /// Each light's contribution.
    pub lights: Vec<RelitLight>,
    /// Light that the scene itself emits.
    pub static_light: Image,
    /// Light of the world.
    pub world: Image,
    /// Albedo of the first non-specular hit.
    pub albedo: Image,
    /// World-space normal of the first non-specular hit.
    pub normal: Image,
    /// Distance to the first hit, metres; 0 where nothing was hit.
    pub depth: Image,
    /// Film alpha.
    pub alpha: Image,
    /// Light of the world behind shadow catchers, dimmed by their shadows; none without them, or where the film is transparent.
    pub backdrop: Option<Image>,
    /// Factor of what shadow catchers show, RGB; none without them.
    pub shadow_catcher: Option<Image>,
    /// Hash of the scene.
    pub scene_hash: String,
    /// Paths per pixel of the dump; 0 if there was none.
    pub samples: u32,
}

impl Relit {
    /// Static layer, world and all lights, RGB, before the world behind shadow catchers.
    pub fn combined(&self) -> Image {
        let mut sum = self.static_light.clone();
        let layers = self.lights.iter().map(|light| &light.image);
        layers.chain([&self.world]).chain(&self.backdrop).for_each(|image| sum.add_scaled(image, &[1.0; 3]));
        sum
    }

    /// [`Relit::combined`] as RGBA with the film's alpha.
    pub fn combined_rgba(&self) -> Image {
        let rgb = self.combined();
        let pixels = rgb.data.chunks_exact(3).zip(&self.alpha.data);
        let data = pixels.flat_map(|(rgb, a)| [rgb[0], rgb[1], rgb[2], *a]).collect();
        Image { width: rgb.width, height: rgb.height, channels: 4, data }
    }

    /// Layers under Blender's pass names: `Combined`, `Combined_<light>`, `static`, `world`, `albedo`, `normal`,
    /// `depth`, `Shadow Catcher` where there is one, and `Diffuse Direct_<light>` and so on where lobes were asked for. The attribute `relume` is JSON: version, scene hash, samples, and the source of each light's layer.
    pub fn layers(&self) -> LayeredImage {
        let combined = self.combined_rgba();
        let (width, height) = (combined.width, combined.height);
        let mut layers = vec![
            Layer::color(COMBINED, combined),
            Layer::color("static", self.static_light.clone()),
            Layer::color("world", self.world.clone()),
            Layer::color("albedo", self.albedo.clone()),
            Layer::vector("normal", self.normal.clone()),
            Layer::depth("depth", self.depth.clone()),
        ];
        let catcher = self.shadow_catcher.iter();
        layers.extend(catcher.map(|image| Layer::color("Shadow Catcher", image.clone())));
        let (mut taken, mut sources) = (HashSet::new(), serde_json::Map::new());
        for light in &self.lights {
            let name = free_name(&light.name, &mut taken);
            sources.insert(name.clone(), serde_json::json!(light.source));
            layers.push(Layer::color(format!("Combined_{name}"), light.image.clone()));
            let lobes = LobePart::ALL.iter().zip(&light.lobes);
            layers.extend(
                lobes.map(|(part, image)| Layer::color(format!("{}_{name}", part.name()), image.clone())),
            );
        }
        // One attribute, because the order of several in a file is random and equal pictures should be equal files.
        let about = serde_json::json!({
            "version": env!("CARGO_PKG_VERSION"),
            "scene_hash": self.scene_hash,
            "samples": self.samples,
            "lights": sources,
        });
        let attributes = BTreeMap::from([("relume".to_string(), about.to_string())]);
        LayeredImage { width, height, layers, attributes }
    }

    /// Writes the multi-layer EXR, atomically.
    pub fn write_exr(
        &self,
        path: &Path,
        layout: ExrLayout,
        precision: Precision,
    ) -> Result<(), SessionError> {
        let mut image = self.layers();
        if layout == ExrLayout::Plain {
            for layer in &mut image.layers {
                let is_picture = layer.name == COMBINED;
                layer.name = if is_picture { String::new() } else { layer.name.replace(' ', "_") };
                layer.view_layer.clear();
            }
        }
        Ok(write_exr(path, &image, precision)?)
    }

    /// Writes the combined picture as PNG, atomically; transparent where the film is.
    pub fn write_png(&self, path: &Path, view: &ViewTransform, depth: BitDepth) -> Result<(), SessionError> {
        let opaque = self.alpha.data.iter().all(|a| *a > 0.999);
        let image = if opaque { self.combined() } else { self.combined_rgba() };
        Ok(write_png(path, &image, view, depth)?)
    }
}

/// The name as it stands in an EXR file (ASCII, no dots), with a number if another light has it.
fn free_name(name: &str, taken: &mut HashSet<String>) -> String {
    let plain: String =
        name.chars().map(|c| if c.is_ascii_graphic() && c != '.' || c == ' ' { c } else { '_' }).collect();
    let plain = if plain.is_empty() { "light".to_string() } else { plain };
    let mut name = plain.clone();
    let mut number = 2;
    while !taken.insert(name.clone()) {
        name = format!("{plain}_{number}");
        number += 1;
    }
    name
}

#[cfg(test)]
mod tests {
    use super::*;

    fn relit(names: &[&str]) -> Relit {
        let image =
            |channels, value: f32| Image { data: vec![value; 4 * channels], ..Image::new(2, 2, channels) };
        let light = |name: &&str| RelitLight {
            name: name.to_string(),
            image: image(3, 0.25),
            source: UnitSource::Proxy,
            lobes: Vec::new(),
        };
        Relit {
            lights: names.iter().map(light).collect(),
            static_light: image(3, 1.0),
            world: image(3, 0.5),
            albedo: image(3, 0.8),
            normal: image(3, 0.0),
            depth: image(1, 3.0),
            alpha: image(1, 1.0),
            backdrop: None,
            shadow_catcher: None,
            scene_hash: "abc".into(),
            samples: 64,
        }
    }

    #[test]
    fn combined_is_the_sum_of_its_layers() {
        assert!(relit(&["a", "b"]).combined().data.iter().all(|v| *v == 2.0));
        assert_eq!(relit(&[]).combined_rgba().data[..4], [1.5, 1.5, 1.5, 1.0]);
    }

    #[test]
    fn lights_of_one_name_keep_their_own_layers() {
        let layers = relit(&["Key.001", "Key_001", "", "Spot \u{e9}"]).layers();
        let names: Vec<_> = layers.layers.iter().skip(6).map(|layer| layer.name.as_str()).collect();
        assert_eq!(names, ["Combined_Key_001", "Combined_Key_001_2", "Combined_light", "Combined_Spot _"]);
        let about: serde_json::Value = serde_json::from_str(&layers.attributes["relume"]).unwrap();
        assert_eq!(about["lights"]["Key_001_2"], "proxy");
        let folder = tempfile::tempdir().unwrap();
        write_exr(&folder.path().join("a.exr"), &layers, Precision::Half).unwrap();
    }

    #[test]
    fn lobes_have_layers_behind_that_of_their_light() {
        let mut relit = relit(&["Key"]);
        relit.lights[0].lobes = vec![Image::new(2, 2, 3); LobePart::ALL.len()];
        let layers = relit.layers();
        let names: Vec<_> = layers.layers.iter().skip(6).map(|layer| layer.name.as_str()).collect();
        assert_eq!(names[..3], ["Combined_Key", "Emission_Key", "Diffuse Direct_Key"]);
        assert_eq!((names.len(), names[9]), (10, "Volume Indirect_Key"));
    }

    #[test]
    fn plain_files_have_the_picture_without_a_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        relit(&["Key light"]).write_exr(&path, ExrLayout::Plain, Precision::Half).unwrap();
        let bytes = std::fs::read(path).unwrap();
        let has = |name: &[u8]| bytes.windows(name.len()).any(|window| window == name);
        assert!(has(b"\0A\0") && has(b"\0R\0") && has(b"\0Combined_Key_light.R\0") && has(b"\0depth.Z\0"));
        assert!(!has(b"ViewLayer") && !has(b"Combined."));
    }
}
