use crate::device::connections::NumberedImages;
use crate::device::gather::{DeviceGather, UnitParts};
use crate::device::image::DeviceImage;
use crate::error::SessionError;
use crate::relight::gathered::Gathered;
use crate::relight::light_cache::LightCache;
use crate::relight::source::UnitSource;
use relume_gather::DenoiseQuality;
use relume_gpu::{Gpu, GpuError};
use relume_image::Image;
use relume_scene::Light;
use std::sync::Arc;

/// Bytes of unit images of all shots that are kept for later; those of the present picture are kept whatever they take.
const LIMIT: usize = 1 << 30;
/// Share of the GPU's otherwise free memory for those on it: paths, proxies and trainings need the rest.
const GPU_SHARE: f64 = 0.25;
/// Lights that are gathered together: memory stays bounded, and progress shows.
pub(crate) const GROUP: usize = 8;

/// Image that a cache and a frame hold.
pub(crate) type SharedImage = Arc<DeviceImage>;

/// Unit images of one light.
#[derive(Default)]
pub(crate) struct UnitImages {
    pub gathered: Gathered,
    /// Proxy's answer.
    proxy: Option<SharedImage>,
    /// Proxy's answer for every second pixel and row, on the CPU.
    half_proxy: Option<SharedImage>,
}

/// Cached unit images of all lights that were asked for lately.
#[derive(Default)]
pub(crate) struct UnitCache(LightCache<UnitImages>);

impl UnitCache {
    /// Unit of a light, made empty if it is new.
    pub fn of(&mut self, light: &Light) -> &mut UnitImages {
        self.0.get_or_insert(light, UnitImages::default)
    }

    /// Unit of a light that was asked for before.
    pub fn get(&self, light: &Light) -> Option<&UnitImages> {
        self.0.get(light)
    }

    /// Finished unit image of a light by one source, if it is known.
    pub fn finished(&mut self, light: &Light, source: UnitSource) -> Result<Option<Image>, GpuError> {
        let Some(unit) = self.0.get_used(light) else { return Ok(None) };
        let gathered = &unit.gathered;
        match source {
            UnitSource::Proxy => unit.proxy.as_deref().map(DeviceImage::read).transpose(),
            UnitSource::Gather => (!gathered.mean.is_empty()).then(|| gathered.noisy()).transpose(),
            UnitSource::GatherDenoised => {
                gathered.newest_clean(DenoiseQuality::High).map(DeviceImage::read).transpose()
            }
        }
    }

    /// True if at least one pass of each light was gathered.
    pub fn all_begun(&self, lights: &[Light]) -> bool {
        lights.iter().all(|light| self.passes(light) > 0)
    }

    /// Passes that a light was gathered from.
    pub fn passes(&self, light: &Light) -> usize {
        self.get(light).map_or(0, |unit| unit.gathered.passes)
    }

    /// Forgets the answers of proxies.
    pub fn clear_proxies(&mut self) {
        self.0.values_mut().for_each(|unit| (unit.proxy, unit.half_proxy) = (None, None));
    }

    /// Gathers one more pass for those of the lights that are furthest behind; false if none is behind. `gather` makes their
    /// images of a pass.
    pub fn advance(
        &mut self,
        lights: &[Light],
        passes: &[DeviceGather],
        gather: impl FnOnce(&DeviceGather, &[Light]) -> Result<Vec<UnitParts>, SessionError>,
    ) -> Result<bool, SessionError> {
        let fewest = lights.iter().map(|light| self.passes(light)).min();
        let Some(pass) = fewest.and_then(|fewest| passes.get(fewest)) else { return Ok(false) };
        let is_behind = |light: &&Light| Some(self.passes(light)) == fewest;
        let group: Vec<Light> = lights.iter().filter(is_behind).take(GROUP).cloned().collect();
        for (light, parts) in group.iter().zip(gather(pass, &group)?) {
            // Of lights that differ by name alone, one adds the pass for all.
            if Some(self.passes(light)) != fewest {
                continue;
            }
            if let Err(error) = self.of(light).gathered.add(parts, pass.samples()) {
                // The image may have been added, or not.
                self.0.remove(light);
                return Err(error.into());
            }
        }
        Ok(true)
    }

    /// Connects one more level for those of the lights that are furthest behind `levels`; false if none is. `connect` makes the
    /// connected light of that many levels.
    pub fn refine(
        &mut self,
        lights: &[Light],
        levels: usize,
        connect: impl FnOnce(&[Light], usize) -> Result<NumberedImages, SessionError>,
    ) -> Result<bool, SessionError> {
        let known = |light: &Light| self.get(light).and_then(|unit| unit.gathered.connected_levels());
        let fewest = lights.iter().filter_map(known).min().filter(|fewest| *fewest < levels);
        let Some(fewest) = fewest else { return Ok(false) };
        let is_behind = |light: &&Light| known(light) == Some(fewest);
        let group: Vec<Light> = lights.iter().filter(is_behind).take(GROUP).cloned().collect();
        for (number, connected) in connect(&group, fewest + 1)? {
            let gathered = &mut self.of(&group[number]).gathered;
            if gathered.connected_levels() == Some(fewest) {
                gathered.take_connected(connected);
            }
        }
        Ok(true)
    }

    /// Forgets the units used longest ago beyond the limits of memory, which as many shots share, but none of `needed`.
    pub fn trim(&mut self, needed: &[Light], shots: usize) {
        self.0.trim(needed, LIMIT / shots, UnitImages::bytes);
        let Some(gpu) = self.0.values().find_map(UnitImages::gpu) else { return };
        let on_gpu: usize = self.0.values().map(UnitImages::bytes_on_gpu).sum();
        let free = gpu.free_memory() as f64 + on_gpu as f64;
        self.0.trim(needed, (GPU_SHARE * free) as usize, UnitImages::bytes_on_gpu);
    }

    /// Moves everything on the GPU to the CPU, and forgets units that cannot be read. True if there was something.
    pub fn leave_gpu(&mut self) -> bool {
        let was_there = self.0.values().any(|unit| unit.gpu().is_some());
        self.0.retain(|unit| unit.leave_gpu().is_ok());
        was_there
    }
}

impl UnitImages {
    /// Keeps a proxy's answer, to which the light's direct view was added.
    pub fn keep_proxy(&mut self, image: Image) {
        self.proxy = Some(Arc::new(DeviceImage::Cpu(image)));
    }

    /// Proxy's answer, evaluated if it is not known yet; with `half`, every second pixel and row are enough.
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
    fn a_proxy_is_asked_once_for_each_size_and_not_for_half_of_what_is_known() {
        let light = Light::unit(LightShape::Sphere { center: glam::Vec3::ZERO, radius: 1.0 });
        let mut units = UnitCache::default();
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
