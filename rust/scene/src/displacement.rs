use glam::Vec3;

use crate::{Input, Mesh};

/// How a material moves the vertices of meshes.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Displacement {
    /// Offset of a vertex, world space, metres.
    pub offset: Input,
    /// Shading normals stay those of the mesh before, since its shaders bump them (Blender's *Displacement and Bump*).
    pub keeps_normals: bool,
}

/// Facts about a mesh, besides its shape, that displacement needs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Displaceable {
    /// Unit normals that the shaders see, one a vertex.
    pub vertex_normals: Vec<Vec3>,
    /// Triangles that stay flat, one a triangle; empty if all stay as their shading normals tell.
    pub flat_triangles: Vec<bool>,
    /// Corner normals are turned as far as the normals of vertices turn, instead of being replaced by those.
    pub turns_corner_normals: bool,
}

/// Shape of a mesh before it was displaced.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Undisplaced {
    /// See [`Mesh::positions`].
    pub positions: Vec<Vec3>,
    /// See [`Mesh::corner_normals`].
    pub corner_normals: Vec<Vec3>,
}

impl Mesh {
    /// Corners of a triangle before displacement.
    pub fn undisplaced_corners(&self, triangle: usize) -> [Vec3; 3] {
        let positions = self.undisplaced.as_ref().map_or(&self.positions, |before| &before.positions);
        self.triangles[triangle].map(|vertex| positions[vertex as usize])
    }

    /// True if the arrays of displacement are as long as the mesh is.
    pub(crate) fn has_sound_displacement(&self) -> bool {
        let before = self.undisplaced.as_ref().is_none_or(|before| {
            before.positions.len() == self.positions.len()
                && before.corner_normals.len() == self.corner_normals.len()
                && before.positions.iter().all(|position| position.is_finite())
        });
        let needs = self.displaceable.as_ref().is_none_or(|needs| {
            needs.vertex_normals.len() == self.positions.len()
                && [0, self.triangles.len()].contains(&needs.flat_triangles.len())
        });
        before && needs
    }
}
