use super::{BRICK, BRICK_VOXELS, Grid};
use glam::{IVec3, Vec3, Vec4};

/// Values between voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GridInterpolation {
    /// Trilinear, from 8 voxels.
    #[default]
    Linear,
    /// Cubic B-spline, from 64 voxels; smoother than the values.
    Cubic,
}

impl GridInterpolation {
    /// Voxels by which a grid reaches beyond its active ones.
    pub(super) fn margin(self) -> f32 {
        match self {
            Self::Linear => 1.0,
            Self::Cubic => 2.0,
        }
    }
}

impl Grid {
    /// Value at a position in voxels: a scalar in all channels, a colour divided by its fourth channel if it has one.
    pub fn value(&self, position: Vec3, interpolation: GridInterpolation) -> Vec3 {
        if !self.is_near(position) {
            return shown(self.unpacked(self.background()), self.channels);
        }
        let sum = match interpolation {
            GridInterpolation::Linear => self.linear(position),
            GridInterpolation::Cubic => self.cubic(position),
        };
        shown(sum, self.channels)
    }

    /// True where a voxel of a brick can have a part in the value. Positions elsewhere may not fit a whole number.
    fn is_near(&self, position: Vec3) -> bool {
        let low = (self.bricks.origin * BRICK as i32).as_vec3() - 2.0;
        let high = low + (self.bricks.counts * BRICK as u32).as_vec3() + 4.0;
        position.cmpge(low).all() && position.cmple(high).all()
    }

    fn linear(&self, position: Vec3) -> Vec4 {
        let floor = position.floor();
        let (low, t) = (floor.as_ivec3(), position - floor);
        let along_z = |x: i32, y: i32| {
            let [a, b] = [0, 1].map(|z| self.voxel(low + IVec3::new(x, y, z)));
            a.lerp(b, t.z)
        };
        let along_y = |x: i32| along_z(x, 0).lerp(along_z(x, 1), t.y);
        along_y(0).lerp(along_y(1), t.x)
    }

    fn cubic(&self, position: Vec3) -> Vec4 {
        let floor = position.floor();
        let low = floor.as_ivec3() - 1;
        let [x, y, z] = (position - floor).to_array().map(spline_weights);
        let mut sum = Vec4::ZERO;
        for (i, x) in x.into_iter().enumerate() {
            for (j, y) in y.into_iter().enumerate() {
                for (k, z) in z.into_iter().enumerate() {
                    sum += x * y * z * self.voxel(low + IVec3::new(i as i32, j as i32, k as i32));
                }
            }
        }
        sum
    }

    /// Numbers of a voxel, 0 in channels that there are not; scalars in all.
    pub(super) fn voxel(&self, voxel: IVec3) -> Vec4 {
        let brick = voxel >> BRICK.trailing_zeros();
        if !self.bricks.contains(brick) {
            return self.unpacked(self.background());
        }
        let slot = self.slots[self.bricks.index(brick)] as usize;
        let [x, y, z] = (voxel & (BRICK as i32 - 1)).to_array().map(|place| place as usize);
        let place = slot * BRICK_VOXELS + (x * BRICK + y) * BRICK + z;
        self.unpacked(&self.values[place * self.channels..][..self.channels])
    }

    fn unpacked(&self, numbers: &[f32]) -> Vec4 {
        match *numbers {
            [value] => Vec4::splat(value),
            [r, g, b] => Vec4::new(r, g, b, 0.0),
            [r, g, b, a] => Vec4::new(r, g, b, a),
            _ => Vec4::ZERO,
        }
    }
}

/// A value as shaders see it.
pub(super) fn shown(value: Vec4, channels: usize) -> Vec3 {
    /// Below it, Cycles leaves a colour as it is.
    const LEAST_DIVISOR: f32 = 1e-6;
    let color = value.truncate();
    if channels == 4 && value.w > LEAST_DIVISOR { color / value.w } else { color }
}

/// Weights of the uniform cubic B-spline.
fn spline_weights(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    let middle = |t: f32| (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0;
    [s * s * s / 6.0, middle(t), middle(s), t * t * t / 6.0]
}
