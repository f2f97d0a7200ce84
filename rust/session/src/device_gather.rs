use relume_gather::{Gather, GpuGather, Half};
use relume_image::Image;
use relume_scene::Light;

use crate::on_gpu::OnGpu;
use crate::progress::Monitor;
use crate::{Compute, SessionError};

/// A gather that the GPU does where there is one, else the CPU.
pub(crate) struct DeviceGather {
    gather: Gather,
    on_gpu: OnGpu<GpuGather>,
}

impl DeviceGather {
    pub fn new(gather: Gather) -> Self {
        Self { gather, on_gpu: OnGpu::default() }
    }

    pub fn gather(&self) -> &Gather {
        &self.gather
    }

    /// Unit images of some lights, by all paths.
    pub fn unit_images(
        &self,
        lights: &[Light],
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<Vec<Image>, SessionError> {
        let lights = self.gather.prepare_all(lights)?;
        let make = |gpu| GpuGather::new(gpu, &self.gather);
        let work = |on_gpu: &GpuGather| on_gpu.unit_images(&lights, Half::All);
        let images = self.on_gpu.attempt(compute, monitor, make, work)?;
        Ok(images.unwrap_or_else(|| self.gather.unit_images(&lights, Half::All)))
    }
}
