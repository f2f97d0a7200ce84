//! Grids of voxels: what fills a volume, such as density and temperature.

mod advection;
mod bounds;
mod dense;
mod look_up;
#[cfg(test)]
mod tests;

pub use advection::{Advection, Velocities};
pub use bounds::GridBounds;
pub use dense::DenseGrid;
pub use look_up::GridInterpolation;

use crate::VdbFile;
use glam::{Affine3A, BVec3, IVec3, UVec3, Vec3};

/// Voxels along an edge of a brick.
pub(crate) const BRICK: usize = 8;
/// Voxels of a brick.
pub(crate) const BRICK_VOXELS: usize = BRICK * BRICK * BRICK;
/// Most memory that a grid may take, in bytes.
const MOST_BYTES: u64 = 8 << 30;
/// Most bricks that the box of a grid may have, most of them empty: 3250 voxels along each edge.
const MOST_BRICKS: u64 = 1 << 26;

/// Values at the whole numbers of an index space, in bricks of 8 x 8 x 8 voxels. Bricks of the same value share their memory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Grid {
    /// Name by which shaders ask for it.
    pub name: String,
    /// Numbers of a voxel: 1, 3 for a colour, or 4 for a colour that is multiplied by the fourth, and shown divided by it.
    pub channels: usize,
    /// Transform of positions in voxels to object space; may mirror and shear.
    pub object_from_index: Affine3A,
    /// Box of bricks that holds all but background.
    pub bricks: Bricks,
    /// Lowest and highest voxel that are active, that is, part of the volume.
    pub active: Option<[IVec3; 2]>,
    /// Place of each brick in [`Grid::values`], counted in bricks; along z first, then y. Number 0 is of background.
    pub slots: Vec<u32>,
    /// Numbers of voxels, those of a voxel side by side, voxels of a brick along z first, then y.
    pub values: Vec<f32>,
}

/// A box of bricks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Bricks {
    /// Lowest brick; its lowest voxel is 8 times that.
    pub origin: IVec3,
    /// Bricks along each axis.
    pub counts: UVec3,
}

impl Bricks {
    /// Number of bricks, as far as it can be counted.
    pub(crate) fn len(&self) -> usize {
        let [x, y, z] = self.counts.to_array().map(|count| count as usize);
        x.saturating_mul(y).saturating_mul(z)
    }

    /// Place of a brick of the box.
    pub(crate) fn index(&self, brick: IVec3) -> usize {
        let [x, y, z] = (brick - self.origin).to_array().map(|step| step as usize);
        (x * self.counts.y as usize + y) * self.counts.z as usize + z
    }

    /// True if a brick lies in the box.
    pub(crate) fn contains(&self, brick: IVec3) -> bool {
        let step = brick.wrapping_sub(self.origin);
        step.cmpge(IVec3::ZERO).all() && step.as_uvec3().cmplt(self.counts).all()
    }
}

/// Checks that a grid of that many bricks, `slots` of which have values of their own, may take its memory.
pub(crate) fn check_size(bricks: &Bricks, slots: usize, channels: usize) -> Result<(), String> {
    let [x, y, z] = bricks.counts.to_array().map(u64::from);
    let count = x.saturating_mul(y).saturating_mul(z);
    let value_bytes = (slots as u64).saturating_mul((BRICK_VOXELS * channels * size_of::<f32>()) as u64);
    let bytes = value_bytes.saturating_add(count.saturating_mul(size_of::<u32>() as u64));
    if count > MOST_BRICKS {
        let edges = [x, y, z].map(|edge| (edge * BRICK as u64).to_string()).join(" x ");
        return Err(format!("it spans {edges} voxels, which is too many; crop it or lower its resolution"));
    }
    if bytes > MOST_BYTES {
        let [needed, most] = [bytes, MOST_BYTES].map(|bytes| bytes as f64 / f64::from(1 << 30));
        return Err(format!(
            "it would take {needed:.1} GiB of memory, and {most:.0} GiB are the most; lower its resolution"
        ));
    }
    Ok(())
}

impl Grid {
    /// Numbers of a voxel that is not in any brick.
    pub fn background(&self) -> &[f32] {
        &self.values[..self.channels]
    }

    /// Moves it by so many voxels.
    pub fn shift(&mut self, voxels: Vec3) {
        self.object_from_index *= Affine3A::from_translation(voxels);
    }

    /// Takes the voxels of a brick for which `is_active` is true, by their places, into the active box.
    pub(crate) fn include_active(&mut self, brick: IVec3, is_active: impl Fn(usize) -> bool) {
        let places = (0..BRICK_VOXELS).filter(|place| is_active(*place)).map(|place| {
            let place = place as i32;
            IVec3::new(place >> 6, place >> 3 & 7, place & 7)
        });
        let found = places.fold(None, |found: Option<[IVec3; 2]>, voxel| {
            let [low, high] = found.unwrap_or([voxel; 2]);
            Some([low.min(voxel), high.max(voxel)])
        });
        if let Some(found) = found {
            let corner = brick * BRICK as i32;
            self.include_box(found.map(|voxel| corner + voxel));
        }
    }

    /// Takes a box of bricks into the active box.
    pub(crate) fn include_active_bricks(&mut self, low: IVec3, high: IVec3) {
        let edge = BRICK as i32;
        self.include_box([low * edge, high * edge + (edge - 1)]);
    }

    fn include_box(&mut self, [low, high]: [IVec3; 2]) {
        let [lowest, highest] = self.active.unwrap_or([low, high]);
        self.active = Some([lowest.min(low), highest.max(high)]);
    }

    /// Corners, in object space, of the box around the active voxels, `margin` voxels wider on each side; none if none is active.
    fn corners(&self, margin: f32) -> Option<[Vec3; 8]> {
        let [low, high] = self.active?;
        let (low, high) = (low.as_vec3() - margin, high.as_vec3() + margin);
        Some(std::array::from_fn(|corner| {
            let is_high = BVec3::new(corner & 1 != 0, corner & 2 != 0, corner & 4 != 0);
            self.object_from_index.transform_point3(Vec3::select(is_high, high, low))
        }))
    }

    /// Fault that makes it unusable, in words.
    pub(crate) fn fault(&self) -> Option<String> {
        let slots = self.values.len() / (BRICK_VOXELS * self.channels.max(1));
        let is_whole = slots > 0 && self.values.len() == slots * BRICK_VOXELS * self.channels;
        let determinant = self.object_from_index.matrix3.determinant();
        if !matches!(self.channels, 1 | 3 | 4) {
            Some(format!("its grid '{}' has {} channels", self.name, self.channels))
        } else if !is_whole
            || self.slots.len() != self.bricks.len()
            || self.slots.iter().any(|slot| *slot as usize >= slots)
        {
            Some(format!("the bricks of its grid '{}' do not fit together", self.name))
        } else if !self.object_from_index.is_finite() || !determinant.is_normal() {
            Some(format!("the transform of its grid '{}' is flat or not finite", self.name))
        } else if self.values.iter().any(|value| !value.is_finite()) {
            Some(format!("its grid '{}' has values that are not finite", self.name))
        } else if !self.is_in_reach() {
            Some(format!("its grid '{}' lies too far away from its origin", self.name))
        } else {
            None
        }
    }

    /// True if all its voxels have numbers that floats can tell apart.
    fn is_in_reach(&self) -> bool {
        const FARTHEST: i32 = 1 << 20;
        let is_near = |place: IVec3| {
            place.cmpge(IVec3::splat(-FARTHEST)).all() && place.cmplt(IVec3::splat(FARTHEST)).all()
        };
        let size = self.bricks.counts.min(UVec3::splat(FARTHEST as u32)).as_ivec3();
        is_near(self.bricks.origin) && is_near(self.bricks.origin + size)
    }

    /// Replaces values that no volume has, and tells which: those that are not finite, and densities below 0, become 0.
    pub(crate) fn heal(&mut self) -> Option<String> {
        let is_density = self.name == DENSITY;
        let mut found = [0_usize; 2];
        for value in &mut self.values {
            if !value.is_finite() {
                found[0] += 1;
                *value = 0.0;
            } else if is_density && *value < 0.0 {
                found[1] += 1;
                *value = 0.0;
            }
        }
        let [infinite, negative] = found;
        let kind = match (infinite, negative) {
            (0, 0) => return None,
            (_, 0) => format!("{infinite} values of grid '{}' are not finite numbers", self.name),
            (0, _) => format!("{negative} values of grid '{}' are below 0", self.name),
            _ => format!(
                "{} values of grid '{}' are below 0 or not finite numbers",
                infinite + negative,
                self.name
            ),
        };
        Some(format!("{kind}; taken as 0"))
    }
}

/// Name of the grid that shaders take for density.
const DENSITY: &str = "density";

/// Grids of one volume, each for one attribute of shaders.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GridSet {
    /// Name of the object that showed it first, for messages.
    pub name: String,
    /// Values between voxels, of all its grids.
    pub interpolation: GridInterpolation,
    /// Grids; names differ.
    pub grids: Vec<Grid>,
    /// Motion of their values; nothing if they stand still.
    pub advection: Option<Advection>,
}

impl GridSet {
    /// Reads the grids of these names from the bytes of an OpenVDB file ([`VdbFile::grid`]), as far as it has them. Grids that cannot
    /// be read are told in words, each of which names its grid.
    ///
    /// # Errors
    /// In words, if it is no such file or is damaged at its start.
    pub fn from_vdb(
        name: &str,
        bytes: &[u8],
        wanted: &[String],
        clipping: f32,
        interpolation: GridInterpolation,
    ) -> Result<(Self, Vec<String>), String> {
        let file = VdbFile::parse(bytes)?;
        let has = |grid: &&String| file.names().any(|name| name == grid.as_str());
        let (mut grids, mut refused) = (Vec::new(), Vec::new());
        for grid in wanted.iter().filter(has) {
            match file.grid(grid, clipping) {
                Ok(grid) => grids.push(grid),
                Err(reason) => refused.push(reason),
            }
        }
        Ok((Self { name: name.to_owned(), interpolation, grids, advection: None }, refused))
    }

    /// Reads the grids of velocities from the file that the others are from, and moves all values by them. Those that cannot be read
    /// are told in words; then the values stand still.
    ///
    /// # Errors
    /// In words, if the file is damaged at its start.
    pub fn advect(&mut self, bytes: &[u8], advection: Advection) -> Result<Vec<String>, String> {
        let missing: Vec<_> =
            advection.grids.iter().filter(|name| self.get(name).is_none()).cloned().collect();
        // Velocities below 0 are not to be clipped.
        let (read, refused) =
            Self::from_vdb(&self.name, bytes, &missing, f32::NEG_INFINITY, self.interpolation)?;
        self.grids.extend(read.grids);
        self.advection = Some(advection).filter(|advection| advection.fault(self).is_none());
        Ok(refused)
    }

    /// The grid of a name.
    pub fn get(&self, name: &str) -> Option<&Grid> {
        self.grids.iter().find(|grid| grid.name == name)
    }

    /// Lowest and highest corner, in object space, of all that active voxels have a part in at any time; none if none is active.
    pub fn hull(&self) -> Option<[Vec3; 2]> {
        let (margin, reach) = (self.interpolation.margin(), self.reach());
        let corners = self.grids.iter().filter_map(|grid| grid.corners(margin)).flatten();
        corners.fold(None, |hull: Option<[Vec3; 2]>, corner| {
            let [low, high] = hull.unwrap_or([corner; 2]);
            Some([low.min(corner - reach), high.max(corner + reach)])
        })
    }
}
