use super::view::{SharedImage, View, pass_samples};
use crate::unit_cache::key;
use crate::{Compute, Monitor, SessionError};
use relume_gather::Half;
use relume_image::Image;
use relume_scene::Light;
use std::sync::Arc;

/// Bytes of unit images that are kept for later; what the present picture needs is kept whatever it takes.
const LIMIT: usize = 1 << 30;
/// Lights that are gathered together.
const GROUP: usize = 8;

/// What is known of one light for radiance 1.
pub(super) struct Unit {
    /// Without name and radiance.
    light: Light,
    /// Mean over the paths of `passes`.
    pub mean: Image,
    pub passes: usize,
    pub samples: u32,
    /// A draw of the error of `mean`; empty for a single pass.
    pub error: Image,
    /// The mean of so many passes, denoised.
    pub clean: Option<(usize, Image)>,
    /// What a proxy says.
    pub proxy: Option<SharedImage>,
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
            let (mean, error, clean, proxy) = (Image::default(), Image::default(), None, None);
            self.list.push(Unit { light: key, mean, passes: 0, samples: 0, error, clean, proxy, used: 0 });
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
        lights.iter().all(|light| self.get(light).is_some_and(|unit| unit.passes > 0))
    }

    /// Forgets what proxies said.
    pub fn clear_proxies(&mut self) {
        self.list.iter_mut().for_each(|unit| unit.proxy = None);
    }

    /// Gathers one more pass for some of the lights, those furthest behind; false if none is behind.
    pub fn advance(
        &mut self,
        lights: &[Light],
        view: &View,
        compute: &Compute,
        monitor: &Monitor,
    ) -> Result<bool, SessionError> {
        let done = |light: &Light| self.get(light).map_or(0, |unit| unit.passes);
        let Some(least) = lights.iter().map(done).min().filter(|least| *least < view.passes.len()) else {
            return Ok(false);
        };
        let group: Vec<Light> =
            lights.iter().filter(|light| done(light) == least).take(GROUP).map(key).collect();
        let pass = &view.passes[least];
        let images = pass.unit_images(&group, Half::All, compute, monitor)?;
        for (light, image) in group.iter().zip(images) {
            self.of(light).add(image, pass_samples(pass));
        }
        self.trim(lights, LIMIT);
        Ok(true)
    }

    /// Forgets the units that were not used for longest, until the rest takes no more than `limit` bytes. Those of `needed` stay:
    /// gathered anew, each would push out another, without end.
    fn trim(&mut self, needed: &[Light], limit: usize) {
        let needed: Vec<Light> = needed.iter().map(key).collect();
        let mut sum: usize = self.list.iter().map(Unit::bytes).sum();
        while sum > limit {
            let others = (0..self.list.len()).filter(|i| !needed.contains(&self.list[*i].light));
            let Some(oldest) = others.min_by_key(|i| self.list[*i].used) else { return };
            sum -= self.list.swap_remove(oldest).bytes();
        }
    }
}

impl Unit {
    fn bytes(&self) -> usize {
        let clean = self.clean.as_ref().map(|(_, image)| image);
        let images = [Some(&self.mean), Some(&self.error), clean, self.proxy.as_deref()];
        images.into_iter().flatten().map(|image| size_of_val(image.data.as_slice())).sum()
    }

    /// Takes the mean of one more pass in.
    fn add(&mut self, image: Image, samples: u32) {
        self.passes += 1;
        self.samples += samples;
        if self.passes == 1 {
            self.mean = image;
            return;
        }
        let share = samples as f32 / self.samples as f32;
        // Means a and b of independent samples, m and n of them: a - b has the variance v (1/m + 1/n), the mean of all has
        // v / (m + n), which is m n / (m + n)^2 of it.
        let scale = (share * (1.0 - share)).sqrt();
        self.error = image;
        for (mean, value) in self.mean.data.iter_mut().zip(&mut self.error.data) {
            let difference = *value - *mean;
            *mean += share * difference;
            *value = scale * difference;
        }
    }

    /// Whether there is a denoised picture of as many or fewer paths.
    pub fn has_clean(&self) -> bool {
        self.clean.is_some()
    }

    /// Whether the denoised picture is of all paths that were gathered.
    pub fn is_clean(&self) -> bool {
        self.clean.as_ref().is_some_and(|(passes, _)| *passes == self.passes)
    }

    /// Remembers what a proxy says.
    pub fn set_proxy(&mut self, image: Image) -> SharedImage {
        let image = Arc::new(image);
        self.proxy = Some(image.clone());
        image
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_scene::LightShape;

    #[test]
    fn what_the_present_picture_needs_is_never_forgotten() {
        let light =
            |radius| crate::targets::unit_light(&LightShape::Sphere { center: glam::Vec3::ZERO, radius });
        let lights: Vec<Light> = [1.0, 2.0, 3.0, 4.0].map(light).to_vec();
        let mut units = Units::default();
        for light in &lights {
            units.of(light).add(Image::new(4, 4, 3), 1);
        }
        let bytes = units.get(&lights[0]).unwrap().bytes();
        assert_eq!(bytes, 4 * 4 * 3 * 4);
        let known = |units: &Units| lights.iter().map(|light| units.get(light).is_some()).collect::<Vec<_>>();
        units.trim(&lights[..2], 3 * bytes);
        assert_eq!(known(&units), [true, true, false, true], "the oldest of the others goes");
        units.trim(&lights[..2], 0);
        assert_eq!(known(&units), [true, true, false, false]);
    }
}
