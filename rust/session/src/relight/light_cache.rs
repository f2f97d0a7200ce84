use relume_scene::Light;

/// Values by light, whatever its name and radiance. The one used longest ago is forgotten first.
pub(crate) struct LightCache<T> {
    entries: Vec<Entry<T>>,
    clock: u64,
}

struct Entry<T> {
    key: Light,
    used: u64,
    value: T,
}

/// Light without name and radiance: all that its unit image depends on.
pub(crate) fn key(light: &Light) -> Light {
    Light { name: String::new(), radiance: [1.0; 3], ..light.clone() }
}

impl<T> Default for LightCache<T> {
    fn default() -> Self {
        Self { entries: Vec::new(), clock: 0 }
    }
}

impl<T> LightCache<T> {
    /// Value of a light, if there is one.
    pub fn get(&self, light: &Light) -> Option<&T> {
        self.position(&key(light)).map(|i| &self.entries[i].value)
    }

    /// Value of a light, if there is one; it counts as used.
    pub fn get_used(&mut self, light: &Light) -> Option<&mut T> {
        self.position(&key(light)).map(|i| self.used(i))
    }

    /// Value of a light, made now if there is none; it counts as used.
    pub fn get_or_insert(&mut self, light: &Light, make: impl FnOnce() -> T) -> &mut T {
        let key = key(light);
        let index = self.position(&key).unwrap_or_else(|| {
            self.entries.push(Entry { key, used: 0, value: make() });
            self.entries.len() - 1
        });
        self.used(index)
    }

    fn used(&mut self, index: usize) -> &mut T {
        self.clock += 1;
        let entry = &mut self.entries[index];
        entry.used = self.clock;
        &mut entry.value
    }

    pub fn values(&self) -> impl Iterator<Item = &T> {
        self.entries.iter().map(|entry| &entry.value)
    }

    pub fn values_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.entries.iter_mut().map(|entry| &mut entry.value)
    }

    pub fn remove(&mut self, light: &Light) {
        let key = key(light);
        self.entries.retain(|entry| entry.key != key);
    }

    /// Keeps the values for which `keep` is true.
    pub fn retain(&mut self, mut keep: impl FnMut(&mut T) -> bool) {
        self.entries.retain_mut(|entry| keep(&mut entry.value));
    }

    /// Forgets values of lights outside `needed` until the others hold at most `limit` of some bytes. Gathered anew, each
    /// needed one would push out another, without end.
    pub fn trim(&mut self, needed: &[Light], limit: usize, bytes: impl Fn(&T) -> usize) {
        let needed: Vec<Light> = needed.iter().map(key).collect();
        let mut sum: usize = self.values().map(&bytes).sum();
        while sum > limit {
            let can_go = |entry: &Entry<T>| bytes(&entry.value) > 0 && !needed.contains(&entry.key);
            let others = (0..self.entries.len()).filter(|i| can_go(&self.entries[*i]));
            let Some(oldest) = others.min_by_key(|i| self.entries[*i].used) else { return };
            sum -= bytes(&self.entries.swap_remove(oldest).value);
        }
    }

    fn position(&self, key: &Light) -> Option<usize> {
        self.entries.iter().position(|entry| entry.key == *key)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use relume_scene::LightShape;

    fn sphere(radius: f32) -> Light {
        Light::unit(LightShape::Sphere { center: Vec3::ONE, radius })
    }

    #[test]
    fn colour_and_name_do_not_matter_but_shape_and_lobes_do() {
        let mut cache = LightCache::default();
        cache.get_or_insert(&sphere(0.1), || 7);
        let mut bright = Light { name: "Key".into(), radiance: [9.0; 3], ..sphere(0.1) };
        assert_eq!(cache.get(&bright), Some(&7));
        bright.lobes.glossy = 0.0;
        assert_eq!(cache.get(&bright), None);
        assert_eq!(cache.get(&sphere(0.2)), None);
    }

    #[test]
    fn what_the_present_picture_needs_is_never_forgotten() {
        let lights = [1.0, 2.0, 3.0, 4.0].map(sphere);
        let mut cache = LightCache::default();
        for light in &lights {
            cache.get_or_insert(light, || 100);
        }
        let known = |cache: &LightCache<usize>| lights.each_ref().map(|light| cache.get(light).is_some());
        cache.trim(&lights[..2], 300, |bytes| *bytes);
        assert_eq!(known(&cache), [true, true, false, true], "the oldest of the others goes");
        cache.trim(&lights[..2], 0, |_| 0);
        assert_eq!(known(&cache), [true, true, false, true], "nothing of that sort is held");
        cache.trim(&lights[..2], 0, |bytes| *bytes);
        assert_eq!(known(&cache), [true, true, false, false]);
    }
}
