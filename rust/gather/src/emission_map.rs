//! Tables of emission at crossings.

use std::sync::Arc;

use glam::{Mat3, Vec3};
use relume_dump::decode_rgb9e5;
use relume_scene::{EmissionMap, PlacedMap};

use crate::light::{Ball, Profile};

/// A table about a light.
#[derive(Clone, Debug)]
pub(crate) struct PreparedMap {
    pub map: Arc<EmissionMap>,
    pub local_from_world: Mat3,
    /// Sphere whose normals it is about; none for directions of segments.
    pub normals_of: Option<Ball>,
}

impl PreparedMap {
    /// The table of a light with this profile.
    ///
    /// # Errors
    /// If its space is not finite, or the light has no table of this kind.
    pub fn new(placed: &PlacedMap, profile: &Profile) -> Result<Self, &'static str> {
        let normals_of = match *profile {
            Profile::Sphere(ball)
            | Profile::Spot { ball, soft_falloff: false, .. }
            | Profile::StretchedSpot { ball, soft_falloff: false, .. } => Some(ball),
            Profile::FacingDisk(_) | Profile::Spot { .. } | Profile::StretchedSpot { .. } => None,
            Profile::Area { .. } | Profile::Sheared(_) | Profile::Sun { .. } => {
                return Err("only points and spots have an emission map");
            }
        };
        let is_sound = placed.local_from_world.is_finite() && placed.local_from_world.determinant() != 0.0;
        if !is_sound {
            return Err("the space of its emission map is not finite or flat");
        }
        Ok(Self {
            map: Arc::clone(&placed.map),
            local_from_world: placed.local_from_world,
            normals_of: normals_of.filter(|_| placed.map.domain.by_normal),
        })
    }

    /// Factor on the radiance along a segment that crosses the light.
    pub fn factor(&self, origin: Vec3, edge: Vec3) -> Vec3 {
        let seen = self.normals_of.map_or(-edge, |ball| ball.normal(origin, edge));
        self.lookup(self.local_from_world * seen)
    }

    /// Factor on the radiance along segments in this direction, wherever they cross the light.
    pub fn factor_along(&self, edge: Vec3) -> Vec3 {
        self.lookup(self.local_from_world * -edge)
    }

    fn lookup(&self, direction: Vec3) -> Vec3 {
        let (width, height) = (self.map.width, self.map.height());
        let [u, v] = self.map.domain.place(direction);
        let (x, y) = (u * width as f32 - 0.5, v * height as f32 - 0.5);
        let (left, low) = (x.floor(), y.floor());
        let closes = self.map.domain.cone.is_none();
        // Directions that are none become the first texel.
        let column = |step: isize| match closes {
            true => (left as isize + step).rem_euclid(width as isize) as usize,
            false => (left as isize + step).clamp(0, width as isize - 1) as usize,
        };
        let row = |step: isize| (low as isize + step).clamp(0, height as isize - 1) as usize;
        let texel = |dx: isize, dy: isize| decode_rgb9e5(self.map.texels[row(dy) * width + column(dx)]);
        let lower = texel(0, 0).lerp(texel(1, 0), x - left);
        let upper = texel(0, 1).lerp(texel(1, 1), x - left);
        lower.lerp(upper, y - low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SampleSplit;
    use crate::tests::kernels::{random_dump_of, random_lights};
    use relume_dump::encode_rgb9e5;
    use relume_scene::MapDomain;

    fn prepared(cone: Option<f32>, normals_of: Option<Ball>) -> PreparedMap {
        let domain = MapDomain { by_normal: normals_of.is_some(), cone };
        let (width, height) = (64, 64);
        let middle = |index: usize| (index as f32 + 0.5) / 64.0;
        // The direction itself, which bilinear interpolation keeps but for its curvature.
        let texel = |index: usize| {
            let direction = domain.direction(middle(index % width), middle(index / width)).normalize();
            encode_rgb9e5(0.5 + 0.5 * direction, Vec3::splat(0.5))
        };
        let map = EmissionMap { domain, width, texels: (0..width * height).map(texel).collect() };
        PreparedMap { map: Arc::new(map), local_from_world: Mat3::IDENTITY, normals_of }
    }

    fn assert_seen(found: Vec3, direction: Vec3) {
        let wanted = 0.5 + 0.5 * direction.normalize();
        assert!((found - wanted).abs().max_element() < 4e-3, "{found} for {wanted}");
    }

    #[test]
    fn segments_are_looked_up_by_the_way_back() {
        let all = prepared(None, None);
        for edge in [Vec3::new(1.0, 0.2, 0.3), Vec3::new(-1.0, 1e-3, -0.4), Vec3::new(-1.0, -1e-3, 2.0)] {
            assert_seen(all.factor(Vec3::ONE, edge), -edge);
        }
        let edge = Vec3::new(0.2, -0.3, 1.0);
        assert_seen(prepared(Some(0.8), None).factor(Vec3::ONE, edge), -edge);
    }

    #[test]
    fn a_map_of_one_texel_scales_images_of_whole_rays_and_of_pieces() {
        let gather = crate::Gather::new(random_dump_of(6, &[8]));
        let texel = encode_rgb9e5(Vec3::new(1.0, 0.5, 0.25), Vec3::splat(0.5));
        for light in random_lights().into_iter().take(3) {
            let domain = MapDomain { by_normal: false, cone: None };
            let map = Arc::new(EmissionMap { domain, width: 1, texels: vec![texel] });
            let placed = PlacedMap { map, local_from_world: Mat3::IDENTITY };
            let mapped = relume_scene::Light { map: Some(placed), ..light.clone() };
            let lights = gather.prepare_all(&[light, mapped]).unwrap();
            let [plain, tinted] = &gather.unit_images(&lights, SampleSplit::All)[..] else { panic!("two") };
            for (plain, tinted) in plain.data.chunks(3).zip(tinted.data.chunks(3)) {
                for (channel, share) in [1.0, 0.5, 0.25].into_iter().enumerate() {
                    assert!((plain[channel] * share - tinted[channel]).abs() <= 1e-6 * plain[channel]);
                }
            }
        }
    }

    #[test]
    fn spheres_are_looked_up_by_their_normal() {
        let ball = Ball { center: Vec3::new(0.0, 0.0, 2.0), radius: 0.5 };
        let aside = prepared(None, Some(ball)).factor(Vec3::new(0.3, 0.0, 0.0), Vec3::Z * 3.0);
        assert_seen(aside, Vec3::new(0.3, 0.0, -0.4));
        let inside = prepared(None, Some(ball)).factor(ball.center, Vec3::Y * 3.0);
        assert_seen(inside, Vec3::Y);
    }
}
