//! Arithmetic on eight floats at a time, written like that on one.

use std::ops::{Add, Mul, Neg, Sub};

use glam::Vec3;

use crate::lanes::{Lanes, WIDTH};

/// [`Lanes`] with operators.
#[derive(Clone, Copy)]
pub struct Wide<L>(pub L);

/// Eight vectors.
#[derive(Clone, Copy)]
pub struct Wide3<L> {
    pub x: Wide<L>,
    pub y: Wide<L>,
    pub z: Wide<L>,
}

impl<L: Lanes> From<f32> for Wide<L> {
    #[inline(always)]
    fn from(value: f32) -> Self {
        Self(L::splat(value))
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident) => {
        impl<L: Lanes> $trait for Wide<L> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0))
            }
        }

        impl<L: Lanes> $trait<f32> for Wide<L> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f32) -> Self {
                Self(self.0.$method(L::splat(other)))
            }
        }

        impl<L: Lanes> $trait<Wide<L>> for f32 {
            type Output = Wide<L>;
            #[inline(always)]
            fn $method(self, other: Wide<L>) -> Wide<L> {
                Wide(L::splat(self).$method(other.0))
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);

impl<L: Lanes> Neg for Wide<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        0.0 - self
    }
}

impl<L: Lanes> Wide<L> {
    #[inline(always)]
    pub fn load(values: &[f32; WIDTH]) -> Self {
        Self(L::load(values))
    }

    /// `1 / self`.
    #[inline(always)]
    pub fn recip(self) -> Self {
        Self(L::splat(1.0).div(self.0))
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        Self(self.0.abs())
    }

    /// 1 with the sign of `self`.
    #[inline(always)]
    pub fn signum(self) -> Self {
        Self(L::splat(1.0).flip_sign_by(self.0))
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0))
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }

    #[inline(always)]
    pub fn clamp(self, low: f32, high: f32) -> Self {
        self.max(low.into()).min(high.into())
    }

    /// `less` where `self < other`, else `not`.
    #[inline(always)]
    pub fn select_less(self, other: Self, less: Self, not: Self) -> Self {
        Self(L::select(self.0.lt(other.0), less.0, not.0))
    }

    /// Adds `self * factor` to eight numbers.
    #[inline(always)]
    pub fn add_scaled_to(self, factor: Self, sums: &mut [f32; WIDTH]) {
        self.0.mul_add(factor.0, L::load(sums)).store(sums);
    }
}

impl<L: Lanes> Wide3<L> {
    #[inline(always)]
    pub fn load([x, y, z]: &[[f32; WIDTH]; 3]) -> Self {
        Self { x: Wide::load(x), y: Wide::load(y), z: Wide::load(z) }
    }

    #[inline(always)]
    pub fn dot(self, other: Self) -> Wide<L> {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }
}

impl<L: Lanes> From<Vec3> for Wide3<L> {
    #[inline(always)]
    fn from(v: Vec3) -> Self {
        Self { x: v.x.into(), y: v.y.into(), z: v.z.into() }
    }
}

impl<L: Lanes> Add for Wide3<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl<L: Lanes> Sub for Wide3<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl<L: Lanes> Mul<Wide<L>> for Wide3<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: Wide<L>) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }
}
