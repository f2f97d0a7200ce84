use super::{Grid, GridInterpolation, GridSet};
use glam::{Affine3A, Vec3};

/// Motion of all values of a set while the shutter is open, by velocities that are grids of the set: semi-Lagrangian, as in Cycles'
/// `kernel/integrator/volume_shader.h`.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Advection {
    /// Names of the grids: one of velocities in object space, or one of numbers for each axis.
    pub grids: Vec<String>,
    /// Way for a velocity of 1 while the shutter is open.
    pub scale: f32,
    /// Time at which values are where the grids have them, where the shutter is open from 0 to 1.
    pub still: f32,
}

/// An [`Advection`] with its grids.
#[derive(Clone, Debug)]
pub struct Velocities {
    /// Numbers of the grids in their set, and transforms of object space to their voxels.
    grids: Vec<(usize, Affine3A)>,
    scale: f32,
    still: f32,
}

impl GridSet {
    /// Velocities by which its values move; nothing if they stand still.
    pub fn velocities(&self) -> Option<Velocities> {
        let advection = self.advection.as_ref()?;
        let place = |name: &String| {
            let number = self.grids.iter().position(|grid| grid.name == *name)?;
            Some((number, self.grids[number].object_from_index.inverse()))
        };
        let grids = advection.grids.iter().map(place).collect::<Option<_>>()?;
        Some(Velocities { grids, scale: advection.scale, still: advection.still })
    }

    /// Farthest way of any value from where the grids have it, along each axis of object space.
    pub fn reach(&self) -> Vec3 {
        let Some(advection) = &self.advection else { return Vec3::ZERO };
        let most = |grid: &Grid, channel: usize| {
            let values = grid.values.iter().skip(channel).step_by(grid.channels);
            values.fold(0.0_f32, |most, value| most.max(value.abs()))
        };
        let speed = match &advection.grids.iter().filter_map(|name| self.get(name)).collect::<Vec<_>>()[..] {
            [grid] if grid.channels == 3 => Vec3::from([0, 1, 2].map(|axis| most(grid, axis))),
            [x, y, z] => Vec3::new(most(x, 0), most(y, 0), most(z, 0)),
            _ => Vec3::ZERO,
        };
        speed * advection.scale.abs() * advection.still.abs().max((1.0 - advection.still).abs())
    }

    /// Fault that makes it unusable, in words.
    pub(crate) fn fault(&self) -> Option<String> {
        self.grids.iter().find_map(Grid::fault).or_else(|| self.advection.as_ref()?.fault(self))
    }
}

impl Advection {
    pub(super) fn fault(&self, set: &GridSet) -> Option<String> {
        let channels = |name: &String| set.get(name).map_or(0, |grid| grid.channels);
        let found: Vec<usize> = self.grids.iter().map(channels).collect();
        let is_known = found == [3] || found == [1, 1, 1];
        let is_sound = is_known && self.scale.is_finite() && self.still.is_finite();
        (!is_sound).then(|| "its velocities have no grids that fit, or are not finite".to_owned())
    }
}

impl Velocities {
    /// Position in object space of what is at `position` at a time.
    pub fn source(&self, set: &GridSet, position: Vec3, time: f32) -> Vec3 {
        let way = (time - self.still) * self.scale;
        let first = position - way * self.velocity(set, position);
        position - way * self.velocity(set, first)
    }

    fn velocity(&self, set: &GridSet, position: Vec3) -> Vec3 {
        let value = |(number, index_from_object): &(usize, Affine3A)| {
            set.grids[*number].value(index_from_object.transform_point3(position), GridInterpolation::Linear)
        };
        match &self.grids[..] {
            [x, y, z] => Vec3::new(value(x).x, value(y).x, value(z).x),
            [all] => value(all),
            _ => Vec3::ZERO,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DenseGrid;

    /// 8 x 8 x 8 voxels of some function of their places.
    fn grid(name: &str, channels: usize, value: impl Fn(Vec3) -> Vec3) -> Grid {
        let voxel = |n: usize| Vec3::new((n % 8) as f32, (n / 8 % 8) as f32, (n / 64) as f32);
        let values: Vec<f32> =
            (0..512).flat_map(|n| value(voxel(n)).to_array()[..channels].to_vec()).collect();
        let object_from_index = Affine3A::from_scale(Vec3::splat(0.5));
        DenseGrid { name, size: [8; 3], channels, values: &values, object_from_index }.to_grid(0.0).unwrap()
    }

    fn set(grids: Vec<Grid>) -> GridSet {
        let names = grids.iter().map(|grid| grid.name.clone()).collect();
        let advection = Some(Advection { grids: names, scale: 2.0, still: 0.25 });
        GridSet { grids, advection, ..GridSet::default() }
    }

    #[test]
    fn values_come_from_where_the_velocity_that_arrives_has_brought_them() {
        // Velocities of x / 2 metres: a step back twice, each time from where the step before ended.
        let set = set(vec![grid("velocity", 3, |voxel| Vec3::new(0.25 * voxel.x, 0.0, -0.5))]);
        let found = set.velocities().unwrap().source(&set, Vec3::splat(2.0), 0.5);
        let way = 0.5 * Vec3::new(0.5 * (2.0 - 0.5 * 1.0), 0.0, -0.5);
        assert!((found - (Vec3::splat(2.0) - way)).length() < 1e-5, "{found}");
        assert_eq!(set.velocities().unwrap().source(&set, Vec3::splat(2.0), 0.25), Vec3::splat(2.0));
        assert!((set.reach() - 1.5 * Vec3::new(1.75, 0.0, 0.5)).length() < 1e-5);
        assert_eq!(set.fault(), None);
    }

    #[test]
    fn velocities_may_be_three_grids() {
        let of_axis = |name: &str, speed: f32| grid(name, 1, move |_| Vec3::splat(speed));
        let set = set(vec![of_axis("x", 0.5), of_axis("y", 1.0), of_axis("z", -0.75)]);
        let found = set.velocities().unwrap().source(&set, Vec3::splat(2.0), 0.75);
        assert!((found - (2.0 - Vec3::new(0.5, 1.0, -0.75))).length() < 1e-5, "{found}");
        assert!((set.reach() - 1.5 * Vec3::new(0.5, 1.0, 0.75)).length() < 1e-5);
    }

    #[test]
    fn velocities_without_grids_are_faults() {
        let mut set = set(vec![grid("velocity", 1, |_| Vec3::ONE)]);
        assert!(set.fault().is_some_and(|fault| fault.contains("velocities")));
        set.advection = None;
        assert_eq!(set.fault(), None);
    }
}
