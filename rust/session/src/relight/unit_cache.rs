use crate::relight::relighter::Maker;
use relume_image::Image;
use relume_scene::Light;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Bytes of unit images that are kept; the oldest go first.
const LIMIT: usize = 1 << 30;

/// Unit images by everything of a light but its name and radiance.
#[derive(Default)]
pub(crate) struct UnitCache {
    entries: Mutex<VecDeque<(Light, Maker, Arc<Image>)>>,
}

impl UnitCache {
    pub(crate) fn get(&self, light: &Light, maker: Maker) -> Option<Arc<Image>> {
        let key = key(light);
        self.lock().iter().find(|(l, m, _)| *m == maker && *l == key).map(|(_, _, image)| image.clone())
    }

    pub(crate) fn insert(&self, light: &Light, maker: Maker, image: Image) -> Arc<Image> {
        let image = Arc::new(image);
        let mut entries = self.lock();
        entries.push_back((key(light), maker, image.clone()));
        let size = |image: &Image| image.data.len() * size_of::<f32>();
        while entries.len() > 1 && entries.iter().map(|(_, _, image)| size(image)).sum::<usize>() > LIMIT {
            entries.pop_front();
        }
        image
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<(Light, Maker, Arc<Image>)>> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A light without name and radiance: what its unit image depends on.
pub(crate) fn key(light: &Light) -> Light {
    Light { name: String::new(), radiance: [1.0; 3], ..light.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use relume_scene::LightShape;

    #[test]
    fn colour_and_name_do_not_matter_but_shape_lobes_and_maker_do() {
        let cache = UnitCache::default();
        let light = Light::unit(LightShape::Sphere { center: Vec3::ONE, radius: 0.1 });
        cache.insert(&light, Maker::Gather, Image::new(1, 1, 3));
        let mut bright = Light { name: "Key".into(), radiance: [9.0; 3], ..light.clone() };
        assert!(cache.get(&bright, Maker::Gather).is_some());
        assert!(cache.get(&bright, Maker::Proxy).is_none());
        bright.lobes.glossy = 0.0;
        assert!(cache.get(&bright, Maker::Gather).is_none());
        let moved = Light::unit(LightShape::Sphere { center: Vec3::ZERO, radius: 0.1 });
        assert!(cache.get(&moved, Maker::Gather).is_none());
    }
}
