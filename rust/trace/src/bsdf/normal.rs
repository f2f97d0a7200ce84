//! Corrections of shading normals so that they do not show as artefacts.

use glam::Vec3;
use relume_scene::BumpShadowing;

/// The normals that tell one side of a surface from the other, on the side of the ray that met it.
#[derive(Clone, Copy, Debug)]
pub struct SideNormals {
    /// The triangle's.
    pub geometric: Vec3,
    /// The interpolated one, before any bump.
    pub shading: Vec3,
}

/// Contribution of what comes along a sampled direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleReach {
    /// The path goes on.
    Path,
    /// The direction is between the true and the shading surface: the path ends with it, but lights along it count. As
    /// in Cycles, which lets light samples but no paths through there.
    Lights,
    /// The path goes on, but lights along the direction do not count, since Cycles samples none there.
    Unlit,
}

impl SideNormals {
    /// Reach of a direction that was chosen as reflection or as `transmission`; nothing if it is on the wrong side.
    pub fn reach(&self, wi: Vec3, transmission: bool) -> Option<SampleReach> {
        if (self.geometric.dot(wi) < 0.0) == transmission {
            Some(SampleReach::Path)
        } else {
            ((self.shading.dot(wi) < 0.0) == transmission).then_some(SampleReach::Lights)
        }
    }
}

/// Bends `normal` towards the geometric normal until the mirror direction of `wo` is above the surface. Cycles'
/// construction: with the geometric normal as z and the shading normal in the x-z plane, the requirement that the
/// mirror direction has height `t` is a quadratic equation in the square of the new normal's z.
pub fn ensure_valid_reflection(geometric_normal: Vec3, wo: Vec3, normal: Vec3) -> Vec3 {
    let mirrored = normal * (2.0 * normal.dot(wo)) - wo;
    let wo_z = wo.dot(geometric_normal);
    // Reflections may always be as shallow as the ray.
    let threshold = (0.9 * wo_z).min(0.01);
    if geometric_normal.dot(mirrored) >= threshold {
        return normal;
    }
    let x = (normal - geometric_normal * normal.dot(geometric_normal)).normalize_or(normal);
    let wo_x = wo.dot(x);
    let a = wo_x * wo_x + wo_z * wo_z;
    let b = 2.0 * (a + wo_z * threshold);
    let c = (threshold + wo_z) * (threshold + wo_z);
    let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
    // The root whose square root has the sign of the equation before squaring.
    let z_squared = 0.25 * (if wo_x < 0.0 { b + root } else { b - root }) / a;
    x * (1.0 - z_squared).max(0.0).sqrt() + geometric_normal * z_squared.max(0.0).sqrt()
}

/// Softens the terminator that a bent `normal` moves, for diffuse closures, relative to the unbent shading normal `smooth`.
pub fn bump_shadowing(kind: BumpShadowing, smooth: Vec3, normal: Vec3, wi: Vec3) -> f32 {
    if smooth == normal {
        return 1.0;
    }
    let [cos_smooth, cos_bend, cos_normal] = [smooth.dot(wi), smooth.dot(normal), normal.dot(wi)];
    match kind {
        BumpShadowing::Cosines => {
            let denominator = cos_normal * cos_bend;
            let g = if denominator == 0.0 { 0.0 } else { cos_smooth / denominator };
            let g = g.clamp(0.0, 1.0);
            g + g * g * (1.0 - g)
        }
        _ if cos_smooth * cos_bend * cos_normal < 0.0 => 0.0,
        BumpShadowing::Off => 1.0,
        BumpShadowing::Facets => {
            let squared_tangent = |cos: f32| (1.0 / (cos * cos).max(1e-12) - 1.0).max(0.0);
            let alpha_squared = (0.125 * squared_tangent(cos_bend)).min(1.0);
            2.0 / (1.0 + (1.0 + alpha_squared * squared_tangent(cos_smooth)).sqrt())
        }
    }
}

/// End of reflection: at the horizon, or before it, which hides the shadows that a coarse mesh casts on its smooth
/// shading (Cycles' Shadow Terminator Shading Offset).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Terminator {
    /// Factor on the angle to the normal, 1 for none.
    frequency: f32,
}

impl Default for Terminator {
    fn default() -> Self {
        Self { frequency: 1.0 }
    }
}

impl Terminator {
    /// Terminator of an offset, 0 for the horizon. Cycles takes none where the angle would be turned over.
    pub fn new(offset: f32) -> Self {
        let frequency = 1.0 / (1.0 - 0.5 * offset);
        if frequency > 1.0 && frequency.is_finite() { Self { frequency } } else { Self::default() }
    }

    /// True if reflection ends at the horizon.
    pub fn is_at_horizon(self) -> bool {
        self.frequency == 1.0
    }

    /// Factor on what is reflected along `wi` about `normal`: the cosine of the larger angle over that of the angle.
    #[inline]
    pub fn factor(self, normal: Vec3, wi: Vec3) -> f32 {
        if self.is_at_horizon() {
            return 1.0;
        }
        let cos = normal.dot(wi).min(1.0);
        if cos <= 0.0 { 1.0 } else { (cos.acos() * self.frequency).cos().max(0.0) / cos }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_the_true_and_the_shading_surface_only_lights_count() {
        let sides = SideNormals { geometric: Vec3::Z, shading: Vec3::new(0.6, 0.0, 0.8) };
        for (wi, reflected, transmitted) in [
            (Vec3::Z, Some(SampleReach::Path), None),
            (Vec3::NEG_Z, None, Some(SampleReach::Path)),
            (Vec3::new(0.99, 0.0, -0.1), Some(SampleReach::Lights), Some(SampleReach::Path)),
            (Vec3::new(-0.99, 0.0, 0.1), Some(SampleReach::Path), Some(SampleReach::Lights)),
        ] {
            assert_eq!(sides.reach(wi, false), reflected, "{wi} reflected");
            assert_eq!(sides.reach(wi, true), transmitted, "{wi} transmitted");
        }
    }

    #[test]
    fn an_offset_ends_reflection_before_the_horizon_and_leaves_transmission() {
        let at = |degrees: f32| Vec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
        let halfway = Terminator::new(1.0);
        for (degrees, expected) in [(0.0, 1.0), (30.0, 0.5 / 0.75f32.sqrt()), (50.0, 0.0), (120.0, 1.0)] {
            assert!((halfway.factor(Vec3::Z, at(degrees)) - expected).abs() < 1e-5, "{degrees}");
        }
        for offset in [0.0, 2.0, 3.0, -1.0, f32::MAX] {
            assert_eq!(Terminator::new(offset).factor(Vec3::Z, at(80.0)), 1.0, "{offset}");
        }
    }

    #[test]
    fn bent_normals_reflect_above_the_surface() {
        for tilt in [0.3f32, 0.8, 1.2, -0.9] {
            for view in [0.2f32, 0.9, 1.4] {
                let wo = Vec3::new(view.sin(), 0.0, view.cos());
                let normal = Vec3::new(tilt.sin() * 0.8, tilt.sin() * 0.6, tilt.cos()).normalize();
                let valid = ensure_valid_reflection(Vec3::Z, wo, normal);
                let mirrored = valid * (2.0 * valid.dot(wo)) - wo;
                assert!((valid.length() - 1.0).abs() < 1e-4);
                assert!(mirrored.z >= (0.9 * wo.z).min(0.01) - 1e-3, "{tilt} {view}: {mirrored}");
            }
        }
    }

    #[test]
    fn valid_normals_stay() {
        let normal = Vec3::new(0.1, 0.2, 1.0).normalize();
        assert_eq!(ensure_valid_reflection(Vec3::Z, Vec3::Z, normal), normal);
    }

    #[test]
    fn shadowing_is_one_without_bump_and_never_above() {
        let normal = Vec3::new(0.6, 0.0, 0.8);
        for kind in [BumpShadowing::Cosines, BumpShadowing::Facets, BumpShadowing::Off] {
            assert_eq!(bump_shadowing(kind, Vec3::Z, Vec3::Z, Vec3::X), 1.0);
            for i in -20..=20 {
                let angle = i as f32 / 20.0 * std::f32::consts::PI;
                let wi = Vec3::new(angle.cos(), 0.0, angle.sin());
                let g = bump_shadowing(kind, Vec3::Z, normal, wi);
                assert!((0.0..=1.0).contains(&g));
                assert!(
                    wi.z > -1e-6 || wi.dot(normal) < 0.0 || g == 0.0,
                    "{kind:?} {angle}: light from behind"
                );
            }
        }
    }

    #[test]
    fn facets_dim_less_than_cosines_and_nothing_where_it_is_off() {
        let (normal, wi) = (Vec3::new(0.5, 0.0, 0.75_f32.sqrt()), Vec3::new(0.75_f32.sqrt(), 0.0, 0.5));
        let of = |kind| bump_shadowing(kind, Vec3::Z, normal, wi);
        assert!((of(BumpShadowing::Cosines) - 0.8148).abs() < 1e-3);
        assert!((of(BumpShadowing::Facets) - 0.9706).abs() < 1e-3);
        assert_eq!(of(BumpShadowing::Off), 1.0);
    }
}
