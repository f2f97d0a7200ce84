use glam::{Vec3, Vec4};

use crate::{
    ColorAttribute, UvMap,
    motion::{is_sphere, shape_fault},
};

/// Spheres in object space.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// Name of the Blender object, for messages.
    pub name: String,
    /// Centres, metres.
    pub positions: Vec<Vec3>,
    /// Radius of each sphere, metres.
    pub radii: Vec<f32>,
    /// Position and radius of all points at each key of their motion, one after the other, in the middle the same as above;
    /// empty if they stand still.
    pub motion: Vec<Vec4>,
    /// UV maps, the active render one first: one coordinate a point.
    pub uv_maps: Vec<UvMap>,
    /// Attributes with a value a point, scene-linear RGBA.
    pub attributes: Vec<ColorAttribute>,
}

impl Points {
    /// Fault in words, if there is any.
    pub(crate) fn fault(&self) -> Option<String> {
        let count = self.positions.len();
        let fits = |len: usize| len == count;
        if let Some(point) = self.positions.iter().position(|position| !position.is_finite()) {
            Some(format!("point {point} is not a finite number; remove it or the modifier that made it"))
        } else if let Some(point) =
            self.radii.iter().position(|radius| !(*radius >= 0.0 && radius.is_finite()))
        {
            Some(format!("the radius of point {point} is not a positive number"))
        } else if !fits(self.radii.len())
            || self.uv_maps.iter().any(|map| !fits(map.coords.len()))
            || self.attributes.iter().any(|attribute| !fits(attribute.colors.len()))
        {
            Some("its arrays differ in length".to_owned())
        } else {
            shape_fault(&self.motion, count, is_sphere).map(str::to_owned)
        }
    }
}
