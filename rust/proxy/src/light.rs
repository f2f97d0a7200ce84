use std::f32::consts::{FRAC_PI_2, PI};

use glam::{Mat3, Vec3};
use relume_scene::{Light, LightShape, LobeFactors};
use serde::{Deserialize, Serialize};

use crate::Rng;

/// Largest number of parameters of a light kind.
pub const MAX_PARAMS: usize = 9;

/// Half angles of the spots that a proxy learns, radians: Blender's spot sizes but the narrowest, which few paths meet.
pub const HALF_ANGLES: [f32; 2] = [0.05, FRAC_PI_2];

/// A type of light, for which one proxy is trained (paper, section 3.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightKind {
    /// [`LightShape::Sphere`]: centre (3), radius.
    Sphere,
    /// [`LightShape::FacingDisk`], Blender's default point light: centre (3), radius.
    FacingDisk,
    /// [`LightShape::Quad`] with the spread of a Lambertian emitter: centre (3), edge u (3), edge v (3).
    ///
    /// The paper counts eight parameters (position, normal, width, height), which leaves the roll about the normal
    /// open. Two perpendicular edges say the same and the roll, and are differentiable everywhere.
    Quad,
    /// [`LightShape::Ellipse`] with that spread: centre (3), diameter u (3), diameter v (3).
    Ellipse,
    /// [`LightShape::Spot`] with soft falloff, Blender's default: centre (3), radius, half angle, blend, axis (3).
    Spot,
    /// [`LightShape::Spot`] without soft falloff, with those parameters.
    SphereSpot,
}

/// Formulas that several kinds share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Form {
    /// Shines alike to all sides.
    Round,
    /// One-sided and flat.
    Flat,
    /// Round, in a cone.
    Cone,
}

impl std::fmt::Display for LightKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Sphere => "sphere",
            Self::FacingDisk => "facing-disk",
            Self::Quad => "quad",
            Self::Ellipse => "ellipse",
            Self::Spot => "spot",
            Self::SphereSpot => "sphere-spot",
        })
    }
}

impl LightKind {
    /// Every kind, the most used ones first: a shot learns them in this order.
    pub const ALL: [Self; 6] =
        [Self::FacingDisk, Self::Sphere, Self::Spot, Self::SphereSpot, Self::Quad, Self::Ellipse];

    /// The formulas of this kind.
    pub(crate) fn form(self) -> Form {
        match self {
            Self::Sphere | Self::FacingDisk => Form::Round,
            Self::Quad | Self::Ellipse => Form::Flat,
            Self::Spot | Self::SphereSpot => Form::Cone,
        }
    }

    /// Number of parameters.
    pub fn param_count(self) -> usize {
        self.param_names().len()
    }

    /// Names of the parameters, in order.
    pub fn param_names(self) -> &'static [&'static str] {
        match self.form() {
            Form::Round => &["center_x", "center_y", "center_z", "radius"],
            Form::Flat => &[
                "center_x", "center_y", "center_z", "edge_u_x", "edge_u_y", "edge_u_z", "edge_v_x",
                "edge_v_y", "edge_v_z",
            ],
            Form::Cone => &[
                "center_x",
                "center_y",
                "center_z",
                "radius",
                "half_angle",
                "blend",
                "axis_x",
                "axis_y",
                "axis_z",
            ],
        }
    }

    /// Sizes of a shape of this kind, of which proxies learn a [`SizeRange`]: radius, or width and height.
    pub fn sizes(self, shape: &LightShape) -> impl Iterator<Item = f32> {
        shape.sizes().into_iter().take(if self.form() == Form::Flat { 2 } else { 1 })
    }

    /// The kind of this shape, if one is learned for it.
    pub fn of(shape: &LightShape) -> Option<Self> {
        let is_wide = |spread: f32| spread >= PI - 1e-4;
        match *shape {
            LightShape::Sphere { .. } => Some(Self::Sphere),
            LightShape::FacingDisk { .. } => Some(Self::FacingDisk),
            LightShape::Quad { spread, .. } if is_wide(spread) => Some(Self::Quad),
            LightShape::Ellipse { spread, .. } if is_wide(spread) => Some(Self::Ellipse),
            LightShape::Spot { soft_falloff: true, .. } => Some(Self::Spot),
            LightShape::Spot { soft_falloff: false, .. } => Some(Self::SphereSpot),
            _ => None,
        }
    }

    /// The kind of this light, if one is learned for lights like it.
    pub fn of_light(light: &Light) -> Option<Self> {
        Self::of(&light.shape).filter(|_| light.map.is_none())
    }

    /// The kind whose proxy can answer for this light, if it has learned its size: a proxy knows Blender's default ray visibility
    /// alone, but for the camera's, and neither linking, other rules, nor cones too narrow for it.
    pub fn answering(light: &Light) -> Option<Self> {
        let usual = LobeFactors::default();
        let is_usual = LobeFactors { camera: usual.camera, ..light.lobes } == usual;
        let is_plain = is_usual && light.receivers.is_none() && light.rules.is_default();
        Self::of_light(light).filter(|_| is_plain && !is_narrow(&light.shape))
    }
}

/// True for spots whose cones are narrower than those that a proxy learns, with a tenth of slack.
pub(crate) fn is_narrow(shape: &LightShape) -> bool {
    matches!(*shape, LightShape::Spot { half_angle, .. } if half_angle < 0.9 * HALF_ANGLES[0])
}

/// The parameters of one light, metres and radians in world space, in the order of [`LightKind::param_names`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightParams {
    kind: LightKind,
    values: [f32; MAX_PARAMS],
}

impl LightParams {
    /// A sphere or facing disk.
    pub fn round(kind: LightKind, center: Vec3, radius: f32) -> Self {
        let mut values = [0.0; MAX_PARAMS];
        values[..3].copy_from_slice(&center.to_array());
        values[3] = radius;
        Self { kind, values }
    }

    /// A quad.
    pub fn quad(center: Vec3, edge_u: Vec3, edge_v: Vec3) -> Self {
        Self::flat(LightKind::Quad, center, edge_u, edge_v)
    }

    /// A quad or ellipse.
    pub fn flat(kind: LightKind, center: Vec3, edge_u: Vec3, edge_v: Vec3) -> Self {
        Self::of_vectors(kind, [center, edge_u, edge_v])
    }

    /// A spot, whose half angle and blend are its `cone`.
    pub fn spot(kind: LightKind, center: Vec3, radius: f32, cone: [f32; 2], axis: Vec3) -> Self {
        Self::of_vectors(kind, [center, Vec3::new(radius, cone[0], cone[1]), axis])
    }

    fn of_vectors(kind: LightKind, vectors: [Vec3; 3]) -> Self {
        let mut values = [0.0; MAX_PARAMS];
        for (to, from) in values.chunks_exact_mut(3).zip(vectors) {
            to.copy_from_slice(&from.to_array());
        }
        Self { kind, values }
    }

    /// A light of this size, which shines down.
    pub(crate) fn facing_down(kind: LightKind, center: Vec3, size: f32) -> Self {
        match kind.form() {
            Form::Round => Self::round(kind, center, size),
            Form::Flat => Self::flat(kind, center, Vec3::X * size, Vec3::NEG_Y * size),
            Form::Cone => Self::spot(kind, center, size, [0.5, 0.5], Vec3::NEG_Z),
        }
    }

    /// Parameters from as many values as the kind has.
    pub fn from_slice(kind: LightKind, params: &[f32]) -> Option<Self> {
        let mut values = [0.0; MAX_PARAMS];
        if params.len() != kind.param_count() {
            return None;
        }
        values[..params.len()].copy_from_slice(params);
        Some(Self { kind, values })
    }

    /// The parameters of a shape, if a kind is learned for it.
    pub fn from_shape(shape: &LightShape) -> Option<Self> {
        let kind = LightKind::of(shape)?;
        Some(match *shape {
            LightShape::Sphere { center, radius } | LightShape::FacingDisk { center, radius } => {
                Self::round(kind, center, radius)
            }
            LightShape::Quad { center, edge_u, edge_v, .. }
            | LightShape::Ellipse { center, edge_u, edge_v, .. } => Self::flat(kind, center, edge_u, edge_v),
            LightShape::Spot { center, radius, axis, half_angle, blend, .. } => {
                Self::spot(kind, center, radius, [half_angle, blend], axis)
            }
            _ => return None,
        })
    }

    /// The shape with these parameters.
    pub fn shape(&self) -> LightShape {
        let center = self.center();
        let [radius, half_angle, blend] = self.vec3(3).to_array();
        let (edge_u, edge_v, spread) = (self.vec3(3), self.vec3(6), PI);
        let spot = |soft_falloff| {
            let axis = self.vec3(6);
            LightShape::Spot { center, radius, axis, half_angle, blend, soft_falloff }
        };
        match self.kind {
            LightKind::Sphere => LightShape::Sphere { center, radius },
            LightKind::FacingDisk => LightShape::FacingDisk { center, radius },
            LightKind::Quad => LightShape::Quad { center, edge_u, edge_v, spread },
            LightKind::Ellipse => LightShape::Ellipse { center, edge_u, edge_v, spread },
            LightKind::Spot => spot(true),
            LightKind::SphereSpot => spot(false),
        }
    }

    /// The kind.
    pub fn kind(&self) -> LightKind {
        self.kind
    }

    /// The values, `kind().param_count()` of them.
    pub fn as_slice(&self) -> &[f32] {
        &self.values[..self.kind.param_count()]
    }

    /// The centre.
    pub fn center(&self) -> Vec3 {
        self.vec3(0)
    }

    fn vec3(&self, start: usize) -> Vec3 {
        Vec3::from_slice(&self.values[start..start + 3])
    }
}

/// Sizes of the lights that a proxy learns, metres: radius, or width and height; drawn log-uniformly.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SizeRange {
    /// Smallest, above 0.
    pub min: f32,
    /// Largest.
    pub max: f32,
}

impl SizeRange {
    fn draw(&self, rng: &mut Rng) -> f32 {
        (self.min.ln() + rng.next_f32() * (self.max / self.min).ln()).exp()
    }
}

/// A random light at `center`: sizes log-uniform in `size`, orientation uniform; half angles of spots uniform in
/// [`HALF_ANGLES`], their blends in 0..1.
pub fn random_light(kind: LightKind, center: Vec3, size: SizeRange, rng: &mut Rng) -> LightParams {
    match kind.form() {
        Form::Round => LightParams::round(kind, center, size.draw(rng)),
        Form::Flat => {
            let frame = random_rotation(rng);
            LightParams::flat(kind, center, frame.x_axis * size.draw(rng), frame.y_axis * size.draw(rng))
        }
        Form::Cone => {
            let [narrow, wide] = HALF_ANGLES;
            let cone = [narrow + (wide - narrow) * rng.next_f32(), rng.next_f32()];
            LightParams::spot(kind, center, size.draw(rng), cone, random_rotation(rng).z_axis)
        }
    }
}

/// A uniform rotation: four normal deviates make a uniform unit quaternion.
fn random_rotation(rng: &mut Rng) -> Mat3 {
    let q = std::array::from_fn(|_| rng.next_normal());
    let q = glam::Quat::from_array(q);
    Mat3::from_quat(if q.length() > 1e-6 { q.normalize() } else { glam::Quat::IDENTITY })
}

/// A light that looks down: at floors below it no feature has a kink.
#[cfg(test)]
pub(crate) fn random_light_facing_down(
    kind: LightKind,
    center: Vec3,
    size: SizeRange,
    rng: &mut Rng,
) -> LightParams {
    if kind.form() == Form::Round {
        return random_light(kind, center, size, rng);
    }
    let tilt = Vec3::new(0.2 * rng.next_normal(), 0.2 * rng.next_normal(), -1.0).normalize();
    if kind.form() == Form::Cone {
        // All that is not far aside lies in the soft edge.
        let cone = [1.3 + 0.15 * rng.next_f32(), 0.96 + 0.04 * rng.next_f32()];
        return LightParams::spot(kind, center, size.draw(rng), cone, tilt);
    }
    let u = tilt.any_orthonormal_vector();
    LightParams::flat(kind, center, u * size.draw(rng), tilt.cross(u) * size.draw(rng))
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_scene::LightRules;

    #[test]
    fn shapes_survive_the_way_there_and_back() {
        let mut rng = Rng::stream(1, 2, 3);
        for kind in LightKind::ALL {
            let size = SizeRange { min: 0.1, max: 2.0 };
            let light = random_light(kind, Vec3::new(1.0, 2.0, 3.0), size, &mut rng);
            assert_eq!(LightParams::from_shape(&light.shape()), Some(light));
            assert_eq!(LightParams::from_slice(kind, light.as_slice()), Some(light));
            assert_eq!(light.as_slice().len(), kind.param_names().len());
        }
    }

    #[test]
    fn random_quads_are_rectangles_within_range() {
        let mut rng = Rng::stream(1, 2, 4);
        for _ in 0..100 {
            let light = random_light(LightKind::Quad, Vec3::ZERO, SizeRange { min: 0.1, max: 2.0 }, &mut rng);
            let (u, v) = (light.vec3(3), light.vec3(6));
            assert!(u.dot(v).abs() < 1e-5 * u.length() * v.length() + 1e-6);
            assert!(u.length() > 0.0999 && u.length() < 2.001, "width {}", u.length());
        }
    }

    #[test]
    fn proxies_answer_for_usual_lights_alone() {
        let light = |kind, half_angle| {
            let cone = [half_angle, 0.1];
            Light::unit(LightParams::spot(kind, Vec3::Z, 0.1, cone, Vec3::NEG_Z).shape())
        };
        for kind in [LightKind::Spot, LightKind::SphereSpot] {
            // Spot sizes of 90, 5.5 and 5 degrees.
            let [wide, slack, narrow] = [90.0_f32, 5.5, 5.0].map(|size| light(kind, 0.5 * size.to_radians()));
            assert_eq!([&wide, &slack].map(LightKind::answering), [Some(kind); 2]);
            assert_eq!((LightKind::answering(&narrow), LightKind::of_light(&narrow)), (None, Some(kind)));
            let rules = LightRules { max_bounces: Some(1), ..LightRules::default() };
            let lobes = |lobes| Light { lobes, ..wide.clone() };
            let usual = LobeFactors::default();
            assert_eq!(LightKind::answering(&lobes(LobeFactors { camera: 1.0, ..usual })), Some(kind));
            assert_eq!(LightKind::answering(&lobes(LobeFactors { glossy: 0.0, ..usual })), None);
            assert_eq!(LightKind::answering(&Light { rules, ..wide }), None);
        }
    }

    #[test]
    fn narrow_area_lights_are_left_to_gather() {
        let (center, edge_u, edge_v, spread) = (Vec3::ZERO, Vec3::X, Vec3::Y, 1.0);
        for shape in [
            LightShape::Quad { center, edge_u, edge_v, spread },
            LightShape::Ellipse { center, edge_u, edge_v, spread },
        ] {
            assert_eq!(LightParams::from_shape(&shape), None);
        }
    }
}
