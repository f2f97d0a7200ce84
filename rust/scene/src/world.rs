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
    /// Medium that fills all space, by the number of a material with a volume, an index into [`crate::Scene::materials`]. Unlike the
    /// rest of the world it decides paths.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume: Option<usize>,
    /// Receiver number of that medium, for light linking.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub receiver: u16,
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
            volume: None,
            receiver: 0,
        }
    }
}
