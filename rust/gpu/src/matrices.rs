//! Matrices of 16-bit floats that the subgroups of a device multiply at once.

use crate::{Gpu, GpuError};

/// Sides of matrices that kernels are written for, best first (`shaders/common/matrices.wgsl`).
const SIDES: [u32; 2] = [16, 8];

/// Matrices that a subgroup multiplies at once, with sums of 16 or of 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Matrices {
    /// Rows and columns of both factors and of the sum: 16 on NVIDIA's and AMD's cards, 8 on Apple's and in Mesa's software.
    pub side: u32,
    /// Invocations of a subgroup.
    pub subgroup: u32,
}

impl Matrices {
    /// The constants of `common/matrices.wgsl`.
    pub fn constants(self) -> [(&'static str, u32); 2] {
        [("SMALL_MATRICES", u32::from(self.side == 8)), ("SUBGROUP", self.subgroup)]
    }
}

impl Gpu {
    /// Matrices of the device; nothing where it has none that kernels are written for, or its driver refuses them all
    /// the same.
    pub fn matrices(&self) -> Option<Matrices> {
        let side = self.limits().matrices?;
        let subgroup = *self.matrix_subgroup().get_or_init(|| self.size_of_subgroup(side).ok());
        Some(Matrices { side, subgroup: subgroup? })
    }

    /// Subgroup size that a kernel with matrices finds.
    fn size_of_subgroup(&self, side: u32) -> Result<u32, GpuError> {
        let constants = [("SMALL_MATRICES", u32::from(side == 8))];
        let kernel = self.kernel("subgroup", "size_of_subgroup", &constants)?;
        let values = self.zeros::<u16>("values", (side * side) as usize)?;
        let invocations = self.zeros::<u32>("invocations", 1)?;
        let mut commands = self.commands("size of a subgroup");
        commands.run(&kernel.bind(&[values.whole(), invocations.whole()])?, 1, &[]);
        commands.submit()?;
        Ok(self.read(&invocations, 0..1)?[0])
    }
}

/// The best side of those that a driver offers with sums of both widths.
pub(crate) fn side(offered: &[wgpu::CooperativeMatrixProperties]) -> Option<u32> {
    use wgpu::CooperativeScalarType::{F16, F32};
    let has = |side: u32, sums: wgpu::CooperativeScalarType| {
        offered.iter().any(|matrix| {
            [matrix.m_size, matrix.n_size, matrix.k_size] == [side; 3]
                && (matrix.ab_type, matrix.cr_type) == (F16, sums)
        })
    };
    SIDES.into_iter().find(|side| has(*side, F16) && has(*side, F32))
}

#[cfg(test)]
mod tests {
    use wgpu::CooperativeScalarType::{F16, F32};

    use super::*;
    use crate::gpu_tests::gpu;

    fn of(size: [u32; 3], sums: wgpu::CooperativeScalarType) -> wgpu::CooperativeMatrixProperties {
        let [m_size, n_size, k_size] = size;
        wgpu::CooperativeMatrixProperties {
            m_size,
            n_size,
            k_size,
            ab_type: F16,
            cr_type: sums,
            saturating_accumulation: false,
        }
    }

    #[test]
    fn the_largest_square_matrices_with_sums_of_both_widths_are_taken() {
        let [small, large] = [8, 16].map(|side| [F16, F32].map(|sums| of([side; 3], sums)));
        assert_eq!(side(&[small, large].concat()), Some(16));
        assert_eq!(side(&small), Some(8));
        assert_eq!(side(&[small[0], small[1], large[0]]), Some(8));
        assert_eq!(side(&[large[1]]), None);
        assert_eq!(side(&[of([8, 16, 16], F16), of([8, 16, 16], F32)]), None);
    }

    #[test]
    fn a_subgroup_with_matrices_is_one_that_the_driver_offers() {
        let Some(matrices) = gpu().matrices() else {
            assert!(
                std::env::var_os("RELUME_NEEDS_MATRICES").is_none(),
                "{} has no matrices",
                gpu().summary().name
            );
            return;
        };
        let (least, most) = gpu().limits().subgroup.expect("subgroups");
        assert!((least..=most).contains(&matrices.subgroup), "{matrices:?}");
    }
}
