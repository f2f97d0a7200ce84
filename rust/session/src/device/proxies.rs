use relume_gpu::GpuError;
use relume_image::Image;
use relume_proxy::{GpuProxy, LightKind, LightParams, Proxy, ProxyError};
use relume_scene::Light;

use crate::device::compute::Compute;
use crate::device::image::DeviceImage;
use crate::device::on_gpu::OnGpu;
use crate::error::SessionError;
use crate::files::proxies::Proxies;
use crate::progress::Monitor;

/// Proxies that the GPU evaluates where there is one, else the CPU.
#[derive(Default)]
pub(crate) struct DeviceProxies {
    proxies: Proxies,
    /// Copies on the GPU, in the order of `proxies`.
    on_gpu: Vec<OnGpu<GpuProxy>>,
}

impl DeviceProxies {
    pub fn new(proxies: Proxies) -> Self {
        Self { on_gpu: proxies.iter().map(|_| OnGpu::default()).collect(), proxies }
    }

    pub fn proxies(&self) -> &Proxies {
        &self.proxies
    }

    /// The unit image of a light that a proxy covers, without the light itself as the camera sees it.
    pub fn unit_image(
        &self,
        light: &Light,
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<Image, SessionError> {
        let (proxy, params) = self.covering(light)?;
        let on_gpu = self.attempt(params.kind(), compute, monitor, |gpu| Ok(gpu.unit_image(&params)?))?;
        on_gpu.map_or_else(|| Ok(proxy.unit_image(&params)?), Ok)
    }

    /// [`DeviceProxies::unit_image`] that stays on the GPU where that makes it and has room.
    pub fn device_image(
        &self,
        light: &Light,
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<DeviceImage, SessionError> {
        let (proxy, params) = self.covering(light)?;
        let on_gpu = |gpu: &GpuProxy| match gpu.gpu_image(&params) {
            Err(ProxyError::Gpu(GpuError::OutOfMemory { .. })) => {
                Ok(DeviceImage::Cpu(gpu.unit_image(&params)?))
            }
            made => Ok(DeviceImage::from_gpu(made?)?),
        };
        let image = self.attempt(params.kind(), compute, monitor, on_gpu)?;
        image.map_or_else(|| Ok(DeviceImage::Cpu(proxy.unit_image(&params)?)), Ok)
    }

    /// [`DeviceProxies::unit_image`] of every second pixel and row only.
    pub fn half_image(&self, light: &Light) -> Result<Image, SessionError> {
        let (proxy, params) = self.covering(light)?;
        let (pixels, [width, height]) = proxy.coarse_pixels(2);
        let mut image = Image::new(width, height, 3);
        proxy.forward_pixels(&pixels, &params, image.data.as_chunks_mut().0)?;
        Ok(image)
    }

    fn covering(&self, light: &Light) -> Result<(&Proxy, LightParams), SessionError> {
        match (self.proxies.covering(light), LightParams::from_shape(&light.shape)) {
            (Some(trained), Some(params)) => Ok((&trained.proxy, params)),
            _ => Err(SessionError::Settings(format!("light '{}' has no proxy", light.name))),
        }
    }

    /// Runs work with a proxy on the GPU; none if there is no such proxy or the CPU has to do it.
    pub fn attempt<R>(
        &self,
        kind: LightKind,
        compute: &Compute,
        monitor: &Monitor,
        work: impl Fn(&GpuProxy) -> Result<R, SessionError>,
    ) -> Result<Option<R>, SessionError> {
        let mut proxies = self.proxies.iter().zip(&self.on_gpu);
        let Some((trained, on_gpu)) = proxies.find(|(trained, _)| trained.proxy.info().kind == kind) else {
            return Ok(None);
        };
        let make = |gpu| Ok(GpuProxy::new(gpu, &trained.proxy)?);
        on_gpu.attempt(compute, monitor, make, work)
    }
}
