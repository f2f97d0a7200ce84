use super::gathered::Gathered;
use super::view::{SharedImage, View, pass_samples};
use crate::device::compute::Compute;
use crate::device::image::DeviceImage;
use crate::error::SessionError;
use crate::progress::Monitor;
use crate::relight::unit_cache::key;
use relume_gather::SampleSplit;
use relume_gpu::{Gpu, GpuError};
use relume_scene::Light;
use std::sync::Arc;

/// Bytes of unit images that are kept for later; what the present picture needs is kept whatever it takes.
const LIMIT: usize = 1 << 30;
/// Share of the GPU's memory that is free otherwise, for those of them that are there: paths, proxies and trainings need the rest.
const GPU_SHARE: f64 = 0.25;
/// Lights that are gathered together.
const GROUP: usize = 8;

/// What is known of one light for radiance 1.
pub(super) struct Unit {
    /// Without name and radiance.
    light: Light,
    pub gathered: Gathered,
    /// What a proxy says.
    proxy: Option<SharedImage>,
    /// What it says of every second pixel and row, on the CPU.
    half_proxy: Option<SharedImage>,
    used: u64,
}

/// Unit images of all lights that were asked for lately.
#[derive(Default)]
pub(super) struct Units {
    list: Vec<Unit>,
    clock: u64,
}

impl Units {
    /// The unit of a light, made empty if it is new.
    pub fn of(&mut self, light: &Light) -> &mut Unit {
        self.clock += 1;
        let key = key(light);
        let index = self.list.iter().position(|unit| unit.light == key).unwrap_or_else(|| {
            self.list.push(Unit::new(key));
            self.list.len() - 1
        });
        self.list[index].used = self.clock;
        &mut self.list[index]
    }

    /// The unit of a light that was asked for before.
    pub fn get(&self, light: &Light) -> Option<&Unit> {
        let key = key(light);
        self.list.iter().find(|unit| unit.light == key)
    }

    /// Whether at least one pass of each light was gathered.
    pub fn all_begun(&self, lights: &[Light]) -> bool {
        lights.iter().all(|light| self.get(light).is_some_and(|unit| unit.gathered.passes > 0))
    }

    /// Forgets what proxies said.
    pub fn clear_proxies(&mut self) {
        self.list.iter_mut().for_each(|unit| (unit.proxy, unit.half_proxy) = (None, None));
    }

    /// Gathers one more pass for some of the lights, those furthest behind; false if none is behind.
    pub fn advance(
        &mut self,
        lights: &[Light],
        view: &View,
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<bool, SessionError> {
        let done = |light: &Light| self.get(light).map_or(0, |unit| unit.gathered.passes);
        let Some(least) = lights.iter().map(done).min().filter(|least| *least < view.passes.len()) else {
            return Ok(false);
        };
        let group: Vec<Light> =
            lights.iter().filter(|light| done(light) == least).take(GROUP).map(key).collect();
        let pass = &view.passes[least];
        let images = pass.device_images(&group, SampleSplit::All, compute, monitor)?;
        for (light, image) in group.iter().zip(images) {
            if let Err(error) = self.of(light).gathered.add(image, pass_samples(pass)) {
                // It may have been taken in, or not.
                self.list.retain(|unit| unit.light != *light);
                return Err(error.into());
            }
        }
        Ok(true)
    }

    /// Forgets what was not used for longest and is too much to be kept. Units of `needed` stay: gathered anew, each would push out
    /// another, without end.
    pub fn trim(&mut self, needed: &[Light]) {
        let needed: Vec<Light> = needed.iter().map(key).collect();
        self.forget(&needed, LIMIT, Unit::bytes);
        let Some(gpu) = self.list.iter().find_map(Unit::gpu) else { return };
        let on_gpu: usize = self.list.iter().map(Unit::bytes_on_gpu).sum();
        let free = gpu.free_memory() as f64 + on_gpu as f64;
        self.forget(&needed, (GPU_SHARE * free) as usize, Unit::bytes_on_gpu);
    }

    /// Forgets units of others than `needed` until all take no more than `limit` of some bytes.
    fn forget(&mut self, needed: &[Light], limit: usize, bytes: impl Fn(&Unit) -> usize) {
        let mut sum: usize = self.list.iter().map(&bytes).sum();
        while sum > limit {
            let goes = |unit: &Unit| bytes(unit) > 0 && !needed.contains(&unit.light);
            let others = (0..self.list.len()).filter(|i| goes(&self.list[*i]));
            let Some(oldest) = others.min_by_key(|i| self.list[*i].used) else { return };
            sum -= bytes(&self.list.swap_remove(oldest));
        }
    }

    /// Brings everything to the CPU that is on the GPU, and forgets units of which that cannot be read. Whether there was something.
    pub fn leave_gpu(&mut self) -> bool {
        let was_there = self.list.iter().any(|unit| unit.gpu().is_some());
        self.list.retain_mut(|unit| unit.leave_gpu().is_ok());
        was_there
    }
}

impl Unit {
    fn new(light: Light) -> Self {
        Self { light, gathered: Gathered::default(), proxy: None, half_proxy: None, used: 0 }
    }

    /// What a proxy says, evaluated if that is not known yet; with `half`, that of every second pixel and row is enough.
    pub fn proxied<E>(
        &mut self,
        half: bool,
        evaluate: impl FnOnce(bool) -> Result<DeviceImage, E>,
    ) -> Result<SharedImage, E> {
        let half = half && self.proxy.is_none();
        let known = if half { &mut self.half_proxy } else { &mut self.proxy };
        if let Some(image) = known {
            return Ok(image.clone());
        }
        Ok(known.insert(Arc::new(evaluate(half)?)).clone())
    }

    fn images(&self) -> impl Iterator<Item = &DeviceImage> {
        self.gathered.images().chain(self.proxy.as_deref()).chain(self.half_proxy.as_deref())
    }

    fn bytes(&self) -> usize {
        self.images().map(DeviceImage::bytes).sum()
    }

    fn bytes_on_gpu(&self) -> usize {
        self.images().filter(|image| image.on_gpu().is_some()).map(DeviceImage::bytes).sum()
    }

    fn gpu(&self) -> Option<&Gpu> {
        let of_proxy = || self.proxy.as_ref()?.on_gpu().map(|image| &**image.gpu());
        self.gathered.gpu().or_else(of_proxy)
    }

    fn leave_gpu(&mut self) -> Result<(), GpuError> {
        self.gathered.leave_gpu()?;
        if let Some(image) = &self.proxy {
            self.proxy = Some(Arc::new(DeviceImage::Cpu(image.read()?)));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_image::Image;
    use relume_scene::LightShape;

    #[test]
    fn what_the_present_picture_needs_is_never_forgotten() {
        let light = |radius| Light::unit(LightShape::Sphere { center: glam::Vec3::ZERO, radius });
        let lights: Vec<Light> = [1.0, 2.0, 3.0, 4.0].map(light).to_vec();
        let mut units = Units::default();
        for light in &lights {
            units.of(light).gathered.add(DeviceImage::Cpu(Image::new(4, 4, 3)), 1).unwrap();
        }
        let bytes = units.get(&lights[0]).unwrap().bytes();
        assert_eq!(bytes, 4 * 4 * 3 * 4);
        let known = |units: &Units| lights.iter().map(|light| units.get(light).is_some()).collect::<Vec<_>>();
        units.forget(&lights[..2], 3 * bytes, Unit::bytes);
        assert_eq!(known(&units), [true, true, false, true], "the oldest of the others goes");
        units.forget(&lights[..2], 0, Unit::bytes_on_gpu);
        assert_eq!(known(&units), [true, true, false, true], "nothing is on a GPU");
        units.forget(&lights[..2], 0, Unit::bytes);
        assert_eq!(known(&units), [true, true, false, false]);
    }

    #[test]
    fn a_proxy_is_asked_once_for_each_size_and_not_for_half_of_what_is_known() {
        let light = Light::unit(LightShape::Sphere { center: glam::Vec3::ZERO, radius: 1.0 });
        let mut units = Units::default();
        let mut asked = Vec::new();
        for half in [true, true, false, true, false] {
            let evaluate = |half: bool| {
                asked.push(half);
                Ok::<_, ()>(DeviceImage::Cpu(Image::new(if half { 2 } else { 4 }, 4, 3)))
            };
            units.of(&light).proxied(half, evaluate).unwrap();
        }
        assert_eq!(asked, [true, false]);
        let unit = units.get(&light).unwrap();
        assert_eq!(unit.bytes(), (2 + 4) * 4 * 3 * 4, "both count");
        assert_eq!(units.of(&light).proxied(true, |_| Err(())).unwrap().bytes(), 4 * 4 * 3 * 4);
        units.clear_proxies();
        assert!(units.of(&light).proxied(true, |_| Err(())).is_err(), "nothing is known any more");
    }
}
