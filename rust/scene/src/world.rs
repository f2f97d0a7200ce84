use glam::Mat3;

/// Radiance seen along rays that leave the scene.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct World {
    /// Radiance, or factor on the texture.
    pub color: [f32; 3],
    /// Equirectangular environment texture, an index into [`crate::Scene::textures`].
    pub texture: Option<usize>,
    /// Texture-space direction from world-space direction (the Mapping node).
    pub texture_from_world: Mat3,
    /// True if camera rays see it; otherwise black (and film transparent).
    pub visible_camera: bool,
    /// Other light for rays of some kinds, which see nothing else of the world. No two have a kind in common.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<WorldPart>,
    /// Medium that fills all space, by the number of a material with a volume, an index into [`crate::Scene::materials`]. Unlike the
    /// rest of the world it decides paths.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume: Option<usize>,
    /// Receiver number of that medium, for light linking.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub receiver: u16,
}

/// Light of a world for rays of some kinds.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct WorldPart {
    /// Rays that see it: those of the camera, diffuse, glossy, transmitted and scattered in media.
    pub rays: [bool; 5],
    /// See [`World::color`].
    pub color: [f32; 3],
    /// See [`World::texture`].
    pub texture: Option<usize>,
    /// See [`World::texture_from_world`].
    pub texture_from_world: Mat3,
}

impl World {
    /// True if it is worth a picture where there is nothing else: it has light, and no medium without end.
    pub fn shows_alone(&self) -> bool {
        let is_lit = self.color != [0.0; 3] || self.parts.iter().any(|part| part.color != [0.0; 3]);
        is_lit && self.volume.is_none()
    }

    /// Rays that see its own light, not a part, in the order of [`WorldPart::rays`].
    pub fn rays(&self) -> [bool; 5] {
        let in_part = |kind: usize| self.parts.iter().any(|part| part.rays[kind]);
        std::array::from_fn(|kind| !in_part(kind) && (kind > 0 || self.visible_camera))
    }
}

fn is_zero(value: &u16) -> bool {
    *value == 0
}

impl Default for World {
    fn default() -> Self {
        Self {
            color: [0.0; 3],
            texture: None,
            texture_from_world: Mat3::IDENTITY,
            visible_camera: true,
            parts: Vec::new(),
            volume: None,
            receiver: 0,
        }
    }
}
