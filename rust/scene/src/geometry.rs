/// Geometry that an [`crate::Instance`] places: an index into a list of [`crate::Scene`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Geometry {
    /// Index into [`crate::Scene::meshes`].
    Mesh(usize),
}

impl Geometry {
    /// Index of a mesh; nothing for other kinds.
    pub fn mesh(self) -> Option<usize> {
        let Self::Mesh(index) = self;
        Some(index)
    }
}

impl From<usize> for Geometry {
    fn from(mesh: usize) -> Self {
        Self::Mesh(mesh)
    }
}
