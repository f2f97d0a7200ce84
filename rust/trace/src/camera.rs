//! Camera rays: where on the film, where on the lens, and the ray between them. Follows Cycles'
//! `kernel/camera/camera.h`, in Blender's camera space (looking down -z).

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};
use relume_scene::{Camera, DepthOfField, Panorama, Pose, Projection, STILL, blend};

use crate::{
    filter::{FilterTable, PixelFilter},
    shutter::ShutterTable,
};

/// The start of a path.
#[derive(Clone, Copy, Debug)]
pub struct CameraRay {
    /// World space, on the near clipping plane.
    pub origin: Vec3,
    /// Unit direction, world space.
    pub direction: Vec3,
    /// Length up to the far clipping plane.
    pub length: f32,
    /// Distance between camera or lens and `origin`.
    pub start: f32,
    /// Radius of the ray's footprint at `origin`, metres (Cycles' compact `dP`).
    pub footprint: f32,
    /// Growth of the footprint per metre (Cycles' compact `dD`).
    pub spread: f32,
}

/// A camera ready to make rays.
#[derive(Clone, Debug)]
pub struct CameraSampler {
    camera: Camera,
    filter: FilterTable,
    shutter: Option<ShutterTable>,
}

impl CameraSampler {
    /// Takes the camera of a scene and the pixel filter.
    pub fn new(camera: &Camera, filter: PixelFilter) -> Self {
        let shutter = camera.shutter.as_ref().map(ShutterTable::new);
        Self { camera: camera.clone(), filter: FilterTable::new(filter), shutter }
    }

    /// True if all rays start at the camera's position (apart from the near clipping plane).
    pub fn is_pinhole(&self) -> bool {
        self.camera.projection != Projection::Orthographic
            && self.lens().is_none()
            && self.camera.motion.is_empty()
    }

    /// Time of a path of row `y` (from the top), for a number that is asked for where anything moves.
    pub fn time(&self, y: usize, u: impl FnOnce() -> f32) -> f32 {
        self.shutter.as_ref().map_or(STILL, |shutter| shutter.time(y, self.camera.height, u()))
    }

    /// The ray of pixel `x`, `y` (from the top left) at a time, for two numbers for the film and two for the lens; none
    /// where a lens shows nothing.
    pub fn ray(&self, x: usize, y: usize, time: f32, u: [f32; 4]) -> Option<CameraRay> {
        let camera = &self.camera;
        let size = Vec2::new(camera.width as f32, camera.height as f32);
        let raster = Vec2::new(x as f32, y as f32)
            + 0.5
            + Vec2::new(self.filter.sample(u[0]), self.filter.sample(u[1]));
        let film = Vec2::new(raster.x, size.y - raster.y) / size;
        let mut window = camera.window_min + (camera.window_max - camera.window_min) * film;
        if let Some([open, close]) = camera.zoom {
            // As Cycles interpolates it: places on the film, not the angle of view.
            window *=
                if time < STILL { blend(open, 1.0, 2.0 * time) } else { blend(1.0, close, 2.0 * time - 1.0) };
        }
        let pixel = (camera.window_max - camera.window_min).abs() / size;
        let lens = self.lens().map_or(Vec2::ZERO, |lens| sample_lens(lens, Vec2::new(u[2], u[3])));
        let focus = camera.depth_of_field.map_or(1.0, |lens| lens.focus_distance);
        let has_lens = self.lens().is_some();

        let (origin, direction, start, length, footprint, spread);
        let depth = camera.clip_end - camera.clip_start;
        match camera.projection {
            Projection::Perspective => {
                let pinhole = window.extend(-1.0);
                // Clipping planes are perpendicular to the axis also where the ray is oblique.
                let per_depth = pinhole.length();
                let on_lens = lens.extend(0.0);
                direction =
                    if has_lens { (pinhole * focus - on_lens).normalize() } else { pinhole / per_depth };
                spread = 0.5 * (pixel.x + pixel.y) / per_depth;
                start = camera.clip_start * per_depth;
                origin = on_lens + direction * start;
                length = depth * per_depth;
                footprint = start * spread;
            }
            Projection::Orthographic => {
                let axis = Vec3::NEG_Z;
                direction = if has_lens { (axis * focus - lens.extend(0.0)).normalize() } else { axis };
                start = camera.clip_start / -direction.z;
                origin = (window + lens).extend(0.0) + direction * start;
                length = depth;
                footprint = 0.5 * (pixel.x + pixel.y);
                spread = 0.0;
            }
            Projection::Panoramic(panorama) => {
                let ahead = panorama.direction(window)?;
                let aside = |step: Vec2| panorama.direction(window + step).unwrap_or(ahead) - ahead;
                let steps = aside(pixel * Vec2::X).length() + aside(pixel * Vec2::Y).length();
                let on_lens = on_aperture(&panorama, ahead, lens);
                direction = if has_lens { (ahead * focus - on_lens).normalize() } else { ahead };
                spread = 0.5 * steps;
                start = camera.clip_start;
                origin = on_lens + direction * start;
                length = depth;
                footprint = start * spread;
            }
        }
        let world = match &camera.motion[..] {
            [] => camera.world_from_camera,
            poses => Pose::at(poses, time),
        };
        Some(CameraRay {
            origin: world.transform_point3(origin),
            direction: world.transform_vector3(direction).normalize_or(Vec3::NEG_Z),
            length,
            start,
            footprint,
            spread,
        })
    }

    fn lens(&self) -> Option<&DepthOfField> {
        self.camera.depth_of_field.as_ref().filter(|lens| lens.aperture_radius > 0.0)
    }
}

/// Point of the aperture in camera space: that of a panorama faces each of its rays.
fn on_aperture(panorama: &Panorama, direction: Vec3, lens: Vec2) -> Vec3 {
    let [u, v] = panorama.aperture_axes(direction);
    u * lens.x + v * lens.y
}

/// A uniform point on the aperture, metres.
fn sample_lens(lens: &DepthOfField, u: Vec2) -> Vec2 {
    let unit = if lens.blades < 3 {
        Vec2::from_angle(TAU * u.y) * u.x.sqrt()
    } else {
        sample_polygon(lens.blades, lens.rotation_rad, u)
    };
    unit * lens.aperture_radius / Vec2::new(lens.ratio, 1.0)
}

/// A uniform point in a regular polygon of radius 1: one of its triangles around the centre, then a point in it. Sides
/// are centred on multiples of `2 pi / blades` from `rotation`.
fn sample_polygon(blades: u32, rotation: f32, u: Vec2) -> Vec2 {
    let scaled = u.x * blades as f32;
    let side = scaled.floor().min(blades as f32 - 1.0);
    let (outwards, along) = ((scaled - side).sqrt(), u.y);
    let half = PI / blades as f32;
    let middle = rotation + side * 2.0 * half;
    let (first, second) = (Vec2::from_angle(middle - half), Vec2::from_angle(middle + half));
    (first + (second - first) * along) * outwards
}

#[cfg(test)]
mod tests {
    use glam::{Affine3A, Quat};

    use super::*;

    const CENTER: [f32; 4] = [0.5; 4];

    fn camera() -> Camera {
        Camera {
            width: 4,
            height: 2,
            window_min: Vec2::new(-1.0, -0.5),
            window_max: Vec2::new(1.0, 0.5),
            clip_start: 0.1,
            clip_end: 100.0,
            ..Camera::default()
        }
    }

    #[test]
    fn perspective_rays_go_through_pixel_centres_top_row_up() {
        let sampler = CameraSampler::new(&camera(), PixelFilter::Box);
        let ray = sampler.ray(0, 0, STILL, CENTER).unwrap();
        let expected = Vec3::new(-0.75, 0.25, -1.0);
        assert!((ray.direction - expected.normalize()).length() < 1e-6, "{ray:?}");
        assert!((ray.origin - expected * 0.1).length() < 1e-6, "starts on the near plane: {ray:?}");
        let end = ray.origin + ray.direction * ray.length;
        assert!((end.z + 100.0).abs() < 1e-3, "ends on the far plane: {end}");
        assert!(sampler.is_pinhole());
    }

    #[test]
    fn cameras_pan_and_zoom_within_the_interval() {
        let turned = [-0.4, 0.0, 0.4].map(Affine3A::from_rotation_y);
        let moving = Camera { motion: Pose::keys(&turned), zoom: Some([3.0, 0.5]), ..camera() };
        let sampler = CameraSampler::new(&moving, PixelFilter::Box);
        for (time, angle, factor) in [(0.0, -0.4, 3.0), (0.25, -0.2, 2.0), (0.5, 0.0, 1.0), (1.0, 0.4, 0.5)] {
            let film = Vec3::new(-0.75 * factor, 0.25 * factor, -1.0).normalize();
            let expected = Quat::from_rotation_y(angle) * film;
            let found = sampler.ray(0, 0, time, CENTER).unwrap().direction;
            assert!((found - expected).length() < 1e-5, "{time}: {found} {expected}");
        }
    }

    #[test]
    fn footprint_is_the_size_of_a_pixel() {
        let sampler = CameraSampler::new(&camera(), PixelFilter::Box);
        let [a, b] = [1, 2].map(|x| sampler.ray(x, 1, STILL, CENTER).unwrap());
        let distance = 10.0 / -a.direction.z;
        let at = |ray: CameraRay| ray.origin + ray.direction * (10.0 / -ray.direction.z - ray.start);
        let footprint = a.footprint + a.spread * (distance - a.start);
        assert!((footprint / (at(a) - at(b)).length() - 1.0).abs() < 0.05);
    }

    #[test]
    fn orthographic_rays_are_parallel_and_a_pixel_apart() {
        let mut ortho = camera();
        ortho.projection = Projection::Orthographic;
        ortho.world_from_camera =
            Affine3A::from_rotation_translation(Quat::from_rotation_x(PI / 2.0), Vec3::new(0.0, 0.0, 5.0));
        let sampler = CameraSampler::new(&ortho, PixelFilter::Box);
        let [a, b] = [sampler.ray(1, 0, STILL, CENTER).unwrap(), sampler.ray(2, 0, STILL, CENTER).unwrap()];
        assert!((a.direction - Vec3::Y).length() < 1e-6 && (b.direction - Vec3::Y).length() < 1e-6);
        assert!((b.origin - a.origin - Vec3::X * 0.5).length() < 1e-5);
        assert!((a.origin.y - 0.1).abs() < 1e-6 && (a.length - 99.9).abs() < 1e-3);
        assert!(!sampler.is_pinhole());
    }

    #[test]
    fn all_lens_rays_of_a_film_point_meet_on_the_focal_plane() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let lens = DepthOfField {
                aperture_radius: 0.2,
                focus_distance: 3.0,
                blades: 0,
                rotation_rad: 0.0,
                ratio: 2.0,
            };
            let with_lens = Camera { projection, depth_of_field: Some(lens), ..camera() };
            let sampler = CameraSampler::new(&with_lens, PixelFilter::Box);
            let at_focus = |u: [f32; 4]| {
                let ray = sampler.ray(3, 1, STILL, u).unwrap();
                ray.origin + ray.direction * ((-3.0 - ray.origin.z) / ray.direction.z)
            };
            let middle = at_focus([0.5, 0.5, 0.0, 0.0]);
            for (a, b) in [(0.9, 0.1), (0.3, 0.6), (0.999, 0.5)] {
                let met = at_focus([0.5, 0.5, a, b]);
                assert!((met - middle).length() < 1e-5, "{projection:?} {met} {middle}");
            }
        }
    }

    #[test]
    fn panoramic_rays_start_near_the_camera_and_meet_where_they_are_in_focus() {
        let fov = 3.0;
        let panoramic = |depth_of_field| Camera {
            projection: Projection::Panoramic(Panorama::FisheyeEquidistant { fov }),
            window_min: Vec2::ZERO,
            window_max: Vec2::ONE,
            depth_of_field,
            ..camera()
        };
        let sampler = CameraSampler::new(&panoramic(None), PixelFilter::Box);
        let ray = sampler.ray(3, 1, STILL, CENTER).unwrap();
        assert!((ray.origin - ray.direction * 0.1).length() < 1e-6 && (ray.length - 99.9).abs() < 1e-3);
        assert!(sampler.is_pinhole());
        assert!(sampler.ray(0, 0, STILL, [0.0, 0.0, 0.5, 0.5]).is_none(), "a corner shows nothing");
        let lens = DepthOfField {
            aperture_radius: 0.2,
            focus_distance: 3.0,
            blades: 0,
            rotation_rad: 0.0,
            ratio: 2.0,
        };
        let sampler = CameraSampler::new(&panoramic(Some(lens)), PixelFilter::Box);
        assert!(!sampler.is_pinhole());
        for lens in [[0.9, 0.1], [0.3, 0.6], [0.999, 0.5]] {
            let on_lens = sampler.ray(3, 1, STILL, [0.5, 0.5, lens[0], lens[1]]).unwrap();
            let beside = ray.direction * 3.0 - on_lens.origin;
            assert!(beside.cross(on_lens.direction).length() < 1e-5, "{lens:?}");
        }
    }

    #[test]
    fn polygons_are_filled_evenly_up_to_their_corners() {
        let count = 20_000;
        let points: Vec<Vec2> = (0..count)
            .map(|i| {
                sample_polygon(
                    5,
                    0.3,
                    Vec2::new((i as f32 + 0.5) / count as f32, (i as f32 * 0.618_034).fract()),
                )
            })
            .collect();
        let mean = points.iter().sum::<Vec2>() / count as f32;
        assert!(mean.length() < 0.01, "{mean}");
        let apothem = (PI / 5.0).cos();
        for side in 0..5 {
            let normal = Vec2::from_angle(0.3 + side as f32 * TAU / 5.0);
            let reach = points.iter().map(|point| point.dot(normal)).fold(0.0, f32::max);
            assert!((reach - apothem).abs() < 0.01, "{reach}");
        }
        // Uniform over the area: mean squared radius of a regular polygon is (1 + 2 cos^2(pi/n)) / 6.
        let squared = points.iter().map(|point| point.length_squared()).sum::<f32>() / count as f32;
        assert!((squared - (1.0 + 2.0 * apothem * apothem) / 6.0).abs() < 0.005, "{squared}");
    }
}
