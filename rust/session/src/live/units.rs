use super::view::{SharedImage, View, pass_samples};
use crate::unit_cache::key;
use crate::{Compute, Monitor, SessionError};
use relume_gather::Half;
use relume_image::Image;
use relume_scene::Light;
use std::sync::Arc;

/// Bytes of unit images that are kept; those that were not used for longest go first.
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
        self.trim();
        Ok(true)
    }

    fn trim(&mut self) {
        let size = |unit: &Unit| {
            let clean = unit.clean.as_ref().map_or(0, |(_, image)| image.data.len());
            size_of::<f32>()
                * (unit.mean.data.len()
                    + unit.error.data.len()
                    + clean
                    + unit.proxy.as_ref().map_or(0, |p| p.data.len()))
        };
        let mut sum: usize = self.list.iter().map(size).sum();
        while sum > LIMIT && self.list.len() > 1 {
            let oldest = (0..self.list.len()).min_by_key(|i| self.list[*i].used).unwrap_or(0);
            sum -= size(&self.list.swap_remove(oldest));
        }
    }
}

impl Unit {
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
