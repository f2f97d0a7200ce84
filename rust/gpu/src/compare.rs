use crate::{Binding, Commands, Gpu, GpuError, Kernel};

/// Pixels of a workgroup of `shaders/common/compare.wgsl`.
const GROUP: usize = 64;

/// Compares a picture with a target (`shaders/common/compare.wgsl`): the step between values and gradients of any light.
#[derive(Debug)]
pub struct CompareKernel(Kernel);

/// Arguments of `compare`, described in the WGSL.
#[derive(Clone, Copy, Debug, bytemuck::NoUninit)]
#[repr(C)]
#[expect(missing_docs, reason = "described in the WGSL twin")]
pub struct CompareArguments {
    pub count: u32,
    pub lights: u32,
    pub exposure: f32,
    pub losses: u32,
}

impl CompareKernel {
    /// For lights of so many quads, the last of which is the radiance, and units of so many values for each pixel, of which RGB come
    /// first.
    ///
    /// # Errors
    /// If the driver refuses it, or the device was lost.
    pub fn new(gpu: &Gpu, light_quads: usize, unit_values: usize) -> Result<Self, GpuError> {
        let constants = [("LIGHT_QUADS", light_quads as u32), ("UNIT_VALUES", unit_values as u32)];
        Ok(Self(gpu.kernel("common/compare", "compare", &constants)?))
    }

    /// Losses that it leaves for so many pixels, to be added up.
    pub fn losses(count: usize) -> usize {
        count.div_ceil(GROUP)
    }

    /// Appends the comparison. The buffers, in the order of the WGSL: lights, pixels, units, base, target, shares in the loss, gradient by the picture,
    /// results.
    ///
    /// # Errors
    /// [`GpuError::Refused`] if they are not what the module declares.
    pub fn add(
        &self,
        commands: &mut Commands<'_>,
        buffers: &[Binding<'_>; 8],
        arguments: &CompareArguments,
    ) -> Result<(), GpuError> {
        let groups = Self::losses(arguments.count as usize) as u32;
        commands.run(&self.0.bind(buffers)?, groups, bytemuck::bytes_of(arguments));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arguments_have_the_layout_of_their_wgsl_twin() {
        crate::assert_mirror!(CompareArguments as "common/compare", "Arguments", {
            count, lights, exposure, losses,
        });
    }
}
