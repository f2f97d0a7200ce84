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
}

impl Default for World {
    fn default() -> Self {
        Self { color: [0.0; 3], texture: None, texture_from_world: Mat3::IDENTITY, visible_camera: true }
    }
}
