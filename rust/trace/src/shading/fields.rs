//! Grids of volumes, found by the names under which shaders ask for them.

use glam::{Affine3A, Vec3, Vec4};
use relume_scene::{Grid, GridSet, Scene, Velocities};

/// Grids of all volumes of a scene.
#[derive(Debug)]
pub(super) struct PreparedFields {
    /// Those of each set, by name numbers.
    sets: Vec<Vec<Option<Field>>>,
    /// Velocities of each set whose values move.
    velocities: Vec<Option<Velocities>>,
}

/// A grid of a set.
#[derive(Clone, Copy, Debug)]
struct Field {
    number: usize,
    index_from_object: Affine3A,
}

impl PreparedFields {
    /// Looks for grids of these names.
    pub fn new(scene: &Scene, names: &[String]) -> Self {
        let field = |set: &GridSet, name: &String| {
            let number = set.grids.iter().position(|grid| grid.name == *name)?;
            Some(Field { number, index_from_object: set.grids[number].object_from_index.inverse() })
        };
        let of_set = |set: &GridSet| names.iter().map(|name| field(set, name)).collect();
        Self {
            sets: scene.grids.iter().map(of_set).collect(),
            velocities: scene.grids.iter().map(GridSet::velocities).collect(),
        }
    }

    /// Value of a grid at a position in object space, a scalar in red, green and blue; nothing if the set has none of that name.
    pub fn value(&self, scene: &Scene, set: usize, name: usize, position: Vec3) -> Option<Vec4> {
        let field = self.sets[set][name]?;
        let set = &scene.grids[set];
        let position = field.index_from_object.transform_point3(position);
        Some(set.grids[field.number].value(position, set.interpolation).extend(1.0))
    }

    /// Velocities of the values of a set; nothing if they stand still.
    pub fn velocities(&self, set: usize) -> Option<&Velocities> {
        self.velocities[set].as_ref()
    }

    /// The grid of a name in a set.
    pub fn grid<'a>(&self, scene: &'a Scene, set: usize, name: usize) -> Option<&'a Grid> {
        self.sets[set][name].map(|field| &scene.grids[set].grids[field.number])
    }
}
