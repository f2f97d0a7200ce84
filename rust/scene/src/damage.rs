//! Damage of a mesh that no ray can meet or shade: numbers that are not finite, or too large.

use crate::{PolygonMesh, PolygonNormals};
use glam::{Affine3A, Vec2, Vec3};

/// Coordinates from which on Embree, and so Cycles, leaves a triangle or an object out, in metres (`FLT_LARGE`).
const TOO_LARGE: f32 = 1.844e18;

/// True if a ray can meet a triangle that has a corner there.
pub fn can_be_met(position: Vec3) -> bool {
    position.is_finite() && position.abs().max_element() < TOO_LARGE
}

/// True if rays can be taken into the space of an object, as far as its transform's size goes.
pub(crate) fn can_be_placed(world_from_object: &Affine3A) -> bool {
    let columns = world_from_object.to_cols_array_2d();
    columns.into_iter().all(|column| can_be_met(column.into()))
        && world_from_object.matrix3.determinant().is_finite()
}

/// A coordinate of a UV map, 0 where it is not finite.
pub(crate) fn sound_uv(uv: Vec2) -> Vec2 {
    Vec2::select(uv.is_finite_mask(), uv, Vec2::ZERO)
}

/// A colour, 0 in the channels that are not finite.
pub(crate) fn sound_color(color: [f32; 4]) -> [f32; 4] {
    color.map(|channel| if channel.is_finite() { channel } else { 0.0 })
}

impl PolygonMesh<'_> {
    /// Damage that [`PolygonMesh::triangulate`] leaves out or replaces, in words; empty for a sound mesh.
    pub fn damage(&self) -> Vec<String> {
        let vertices = count(self.positions, |position| can_be_met(*position));
        let normals = match self.normals {
            PolygonNormals::Flat => 0,
            PolygonNormals::Vertex(normals) | PolygonNormals::Corner(normals) => {
                count(normals, |normal| normal.is_finite())
            }
        };
        let mut found = Vec::new();
        if vertices > 0 {
            found.push(format!(
                "{vertices} of its vertices have no finite place or one too far away; faces there are left out"
            ));
        } else if normals > 0 {
            found.push(format!("{normals} of its normals are not finite numbers; flat there"));
        }
        for (name, coords) in &self.uv_maps {
            found.extend(zeroed("UV map", name, count(coords, |uv| uv.is_finite())));
        }
        for (name, colors) in &self.color_attributes {
            let unsound = count(colors, |color| color.iter().all(|channel| channel.is_finite()));
            found.extend(zeroed("attribute", name, unsound));
        }
        found
    }
}

fn zeroed(kind: &str, name: &str, values: usize) -> Option<String> {
    (values > 0).then(|| format!("{values} values of its {kind} '{name}' are not finite numbers; taken as 0"))
}

/// Number of values that are not sound.
fn count<T>(values: &[T], is_sound: impl Fn(&T) -> bool) -> usize {
    values.iter().filter(|value| !is_sound(value)).count()
}
