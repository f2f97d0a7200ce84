//! Tables of emission at crossings.

use std::sync::Arc;

use glam::{Mat3, Vec3};
use relume_dump::decode_rgb9e5;
use relume_scene::{EmissionMap, MapKey, PlacedMap};

use crate::light::{Ball, Plane, Profile};

/// A table about a light.
#[derive(Clone, Debug)]
pub(crate) struct PreparedMap {
    pub map: Arc<EmissionMap>,
    pub local_from_world: Mat3,
    pub key: PreparedKey,
    /// Geometry of the light, for distances.
    profile: Profile,
}

/// Quantity by which a table is looked up.
#[derive(Clone, Copy, Debug)]
pub(crate) enum PreparedKey {
    /// The way back along a segment.
    WayBack,
    /// Normals of a sphere.
    Normal(Ball),
    /// Places on an area, whose edges go along the table's columns and rows.
    Place(Plane),
}

impl PreparedMap {
    /// The table of a light with this profile.
    ///
    /// # Errors
    /// If its space is not finite, or the light has no table of this kind.
    pub fn new(placed: &PlacedMap, profile: &Profile) -> Result<Self, &'static str> {
        let local_from_world = placed.local_from_world;
        let key = match (placed.map.domain.key, *profile) {
            (_, Profile::Sheared(_)) => return Err("it is sheared, and has an emission map"),
            (
                MapKey::Normal,
                Profile::Sphere(ball)
                | Profile::Spot { ball, soft_falloff: false, .. }
                | Profile::StretchedSpot { ball, soft_falloff: false, .. },
            ) => PreparedKey::Normal(ball),
            (MapKey::Place, Profile::Area { plane, .. }) => PreparedKey::Place(plane.along(local_from_world)),
            (MapKey::Place, _) => return Err("only area lights have an emission map by place"),
            (MapKey::Normal | MapKey::WayBack, _) => PreparedKey::WayBack,
        };
        let is_sound = local_from_world.is_finite() && local_from_world.determinant() != 0.0;
        if !is_sound {
            return Err("the space of its emission map is not finite or flat");
        }
        Ok(Self { map: Arc::clone(&placed.map), local_from_world, key, profile: *profile })
    }

    /// Factor on the radiance along a ray that crosses the light, from where it began.
    pub fn factor(&self, origin: Vec3, edge: Vec3) -> Vec3 {
        let by_distance = match self.map.falloff.is_none() {
            true => 1.0,
            false => self.map.falloff.factor(self.profile.distance(origin, edge)),
        };
        by_distance * self.texels(origin, edge)
    }

    /// Factor on the radiance along a ray that may pass a smoothed light: by the way back in place of normals.
    pub fn factor_near(&self, origin: Vec3, edge: Vec3) -> Vec3 {
        let texels = match self.key {
            PreparedKey::Normal(_) => self.lookup(self.map.domain.place(self.local_from_world * -edge)),
            PreparedKey::WayBack | PreparedKey::Place(_) => self.texels(origin, edge),
        };
        match self.map.falloff.is_none() {
            true => texels,
            false => self.map.falloff.factor(self.profile.distance_near(origin)) * texels,
        }
    }

    /// Value of the table for a ray that crosses the light.
    fn texels(&self, origin: Vec3, edge: Vec3) -> Vec3 {
        let of_direction = |direction: Vec3| self.map.domain.place(self.local_from_world * direction);
        self.lookup(match &self.key {
            PreparedKey::WayBack => of_direction(-edge),
            PreparedKey::Normal(ball) => of_direction(ball.normal(origin, edge)),
            PreparedKey::Place(plane) => plane.place(origin, edge).map(|share| share + 0.5),
        })
    }

    /// Bilinear value at a place of the table.
    fn lookup(&self, [u, v]: [f32; 2]) -> Vec3 {
        let (width, height) = (self.map.width, self.map.height());
        let among = |share: f32, count: usize| (share * count as f32 - 0.5).max(-1.0).min(count as f32);
        let (x, y) = (among(u, width), among(v, height));
        let (left, low) = (x.floor(), y.floor());
        let closes = self.map.domain.closes();
        // What is no number becomes the first texel.
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
    use relume_scene::{Falloff, LightShape, MapDomain};

    fn prepared(cone: Option<f32>, key: PreparedKey) -> PreparedMap {
        let domain = MapDomain { key: MapKey::WayBack, cone };
        let (width, height) = (64, 64);
        let middle = |index: usize| (index as f32 + 0.5) / 64.0;
        // The direction itself, which bilinear interpolation keeps but for its curvature.
        let texel = |index: usize| {
            let direction = domain.direction(middle(index % width), middle(index / width)).normalize();
            encode_rgb9e5(0.5 + 0.5 * direction, Vec3::splat(0.5))
        };
        let map = EmissionMap {
            domain,
            width,
            texels: (0..width * height).map(texel).collect(),
            falloff: Falloff::default(),
        };
        PreparedMap {
            map: Arc::new(map),
            local_from_world: Mat3::IDENTITY,
            key,
            profile: Profile::Sun { direction: Vec3::Z, chord2: 1.0 },
        }
    }

    fn assert_seen(found: Vec3, direction: Vec3) {
        let wanted = 0.5 + 0.5 * direction.normalize();
        assert!((found - wanted).abs().max_element() < 4e-3, "{found} for {wanted}");
    }

    #[test]
    fn segments_are_looked_up_by_the_way_back() {
        let all = prepared(None, PreparedKey::WayBack);
        for edge in [Vec3::new(1.0, 0.2, 0.3), Vec3::new(-1.0, 1e-3, -0.4), Vec3::new(-1.0, -1e-3, 2.0)] {
            assert_seen(all.factor(Vec3::ONE, edge), -edge);
        }
        let edge = Vec3::new(0.2, -0.3, 1.0);
        assert_seen(prepared(Some(0.8), PreparedKey::WayBack).factor(Vec3::ONE, edge), -edge);
    }

    #[test]
    fn a_map_of_one_texel_scales_images_of_whole_rays_and_of_pieces() {
        let gather = crate::Gather::new(random_dump_of(6, &[8]));
        let texel = encode_rgb9e5(Vec3::new(1.0, 0.5, 0.25), Vec3::splat(0.5));
        for light in random_lights().into_iter().filter(|light| !is_sheared(light)) {
            let domain = MapDomain { key: MapKey::WayBack, cone: None };
            let map =
                Arc::new(EmissionMap { domain, width: 1, texels: vec![texel], falloff: Falloff::default() });
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

    fn is_sheared(light: &relume_scene::Light) -> bool {
        matches!(light.shape, LightShape::Sheared { .. })
    }

    #[test]
    fn areas_are_looked_up_by_the_place_on_them() {
        let domain = MapDomain { key: MapKey::Place, cone: None };
        let (width, height) = (40, 20);
        let texel = |index: usize| {
            let [u, v] = [(index % width) as f32 / width as f32, (index / width) as f32 / height as f32];
            encode_rgb9e5(Vec3::new(u, v, 0.0), Vec3::splat(0.5))
        };
        let map = Arc::new(EmissionMap {
            domain,
            width,
            texels: (0..width * height).map(texel).collect(),
            falloff: Falloff::default(),
        });
        let center = Vec3::new(1.0, 2.0, 3.0);
        // As areas of Blender lie, whose light goes along -z: the second edge is turned over unless a scale mirrors.
        for flip in [-1.0, 1.0] {
            let (edge_u, edge_v) = (4.0 * Vec3::X, 2.0 * flip * Vec3::Y);
            let shape = LightShape::Quad { center, edge_u, edge_v, spread: std::f32::consts::PI };
            let local_from_world = Mat3::from_diagonal(Vec3::new(1.0, 1.0, -flip));
            let placed = PlacedMap { map: Arc::clone(&map), local_from_world };
            let light = relume_scene::Light { map: Some(placed), ..relume_scene::Light::unit(shape) };
            let prepared = crate::PreparedLight::new(&light, 0.0).unwrap().map.unwrap();
            let origin = Vec3::new(0.0, 0.0, flip * 5.0 + 3.0);
            let target = center + Vec3::new(1.0, -0.5, 0.0);
            let found = prepared.factor(origin, 2.0 * (target - origin));
            let wanted = Vec3::new(0.75 - 0.5 / 40.0, 0.25 - 0.5 / 20.0, 0.0);
            assert!((found - wanted).abs().max_element() < 4e-3, "{flip}: {found}");
        }
    }

    #[test]
    fn distances_are_those_to_where_a_light_is_crossed() {
        let ball = Ball { center: Vec3::new(0.0, 0.0, 3.0), radius: 0.5 };
        let (aside, edge) = (Vec3::new(0.3, 0.0, 0.0), 10.0 * Vec3::Z);
        let near = |found: f32, wanted: f32| assert!((found - wanted).abs() < 1e-5, "{found} for {wanted}");
        near(Profile::Sphere(ball).distance(aside, edge), 2.6);
        near(Profile::Sphere(ball).distance(ball.center, edge), 0.5);
        // A facing disk stands across the line to its centre.
        near(Profile::FacingDisk(ball).distance(aside, edge), (9.0 + 0.09) / 3.0);
        let plane = Plane {
            center: ball.center,
            normal: Vec3::NEG_Z,
            inverse_u: Vec3::X,
            inverse_v: Vec3::Y,
            is_ellipse: false,
        };
        near(
            Profile::Area { plane, spread: None }.distance(aside, Vec3::new(0.0, 1.0, 1.0)),
            18.0_f32.sqrt(),
        );
        let falloff = Falloff { power: 2.0, smooth: 0.5 };
        near(falloff.factor(2.0), 4.0 * 4.0 / 4.5);
    }

    #[test]
    fn spheres_are_looked_up_by_their_normal() {
        let ball = Ball { center: Vec3::new(0.0, 0.0, 2.0), radius: 0.5 };
        let aside = prepared(None, PreparedKey::Normal(ball)).factor(Vec3::new(0.3, 0.0, 0.0), Vec3::Z * 3.0);
        assert_seen(aside, Vec3::new(0.3, 0.0, -0.4));
        let inside = prepared(None, PreparedKey::Normal(ball)).factor(ball.center, Vec3::Y * 3.0);
        assert_seen(inside, Vec3::Y);
    }
}
