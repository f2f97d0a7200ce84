use crate::{Curves, Instance, Mesh, Points, Scene};

/// Geometry that an [`crate::Instance`] places: an index into a list of [`crate::Scene`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Geometry {
    /// Index into [`crate::Scene::meshes`].
    Mesh(usize),
    /// Index into [`crate::Scene::curves`].
    Curves(usize),
    /// Index into [`crate::Scene::points`].
    Points(usize),
}

impl From<usize> for Geometry {
    fn from(mesh: usize) -> Self {
        Self::Mesh(mesh)
    }
}

impl Scene {
    /// True if the camera may meet shadow catchers.
    pub fn has_shadow_catchers(&self) -> bool {
        self.instances.iter().any(Instance::catches_shadows)
    }

    /// The mesh that a geometry is; nothing for other kinds, or if it does not exist.
    pub fn mesh(&self, geometry: Geometry) -> Option<&Mesh> {
        let Geometry::Mesh(index) = geometry else { return None };
        self.meshes.get(index)
    }

    /// The curves that a geometry is; nothing for other kinds, or if they do not exist.
    pub fn curves(&self, geometry: Geometry) -> Option<&Curves> {
        let Geometry::Curves(index) = geometry else { return None };
        self.curves.get(index)
    }

    /// The points that a geometry is; nothing for other kinds, or if they do not exist.
    pub fn points(&self, geometry: Geometry) -> Option<&Points> {
        let Geometry::Points(index) = geometry else { return None };
        self.points.get(index)
    }

    /// Number of triangles, spans of curves or points of a geometry that exists.
    pub fn primitive_count(&self, geometry: Geometry) -> usize {
        match geometry {
            Geometry::Mesh(index) => self.meshes.get(index).map_or(0, |mesh| mesh.triangles.len()),
            Geometry::Curves(index) => self.curves.get(index).map_or(0, Curves::span_count),
            Geometry::Points(index) => self.points.get(index).map_or(0, |points| points.positions.len()),
        }
    }

    /// Fault of a geometry that no list has.
    pub(crate) fn missing(&self, geometry: Geometry) -> Option<&'static str> {
        match geometry {
            Geometry::Mesh(index) => (index >= self.meshes.len()).then_some("its mesh does not exist"),
            Geometry::Curves(index) => (index >= self.curves.len()).then_some("its curves do not exist"),
            Geometry::Points(index) => (index >= self.points.len()).then_some("its points do not exist"),
        }
    }
}
