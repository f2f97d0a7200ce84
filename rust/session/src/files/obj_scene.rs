use crate::error::SessionError;
use glam::{Affine3A, Mat3, Vec2, Vec3};
use relume_scene::{Camera, Scene, UpAxis, World, load_obj};
use std::path::Path;

/// View and scale, which an OBJ file does not hold.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjView {
    /// Up axis of the file.
    pub up: UpAxis,
    /// Position of the camera, world space (z up), metres; none frames the whole scene from the front.
    pub eye: Option<Vec3>,
    /// Target of the camera; none is the middle of the scene.
    pub target: Option<Vec3>,
    /// Angle across the longer edge of the picture, degrees.
    pub fov_degrees: f32,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Radiance of the world, RGB.
    pub world: [f32; 3],
}

impl Default for ObjView {
    fn default() -> Self {
        let (up, fov_degrees) = (UpAxis::Y, 40.0);
        Self { up, eye: None, target: None, fov_degrees, width: 640, height: 360, world: [0.0; 3] }
    }
}

/// Loads an OBJ file and looks at it.
///
/// # Errors
/// [`SessionError`] names the file, or the setting that makes no camera.
pub fn obj_scene(path: &Path, view: &ObjView) -> Result<Scene, SessionError> {
    let mut builder = load_obj(path, view.up)?;
    builder.set_camera(Camera::default());
    builder.set_world(World { color: view.world, ..World::default() })?;
    let mut scene = builder.build()?;
    scene.camera = camera(&scene, view)?;
    Ok(scene)
}

fn camera(scene: &Scene, view: &ObjView) -> Result<Camera, SessionError> {
    let fail = |reason: &str| Err(SessionError::Settings(reason.into()));
    if !(1.0..=170.0).contains(&view.fov_degrees) {
        return fail("the field of view must be 1 to 170 degrees");
    }
    if view.width == 0 || view.height == 0 || view.width > 65_536 || view.height > 65_536 {
        return fail("width and height must be 1 to 65536 pixels");
    }
    let positions = || scene.meshes.iter().flat_map(|mesh| &mesh.positions);
    let low = positions().copied().fold(Vec3::INFINITY, Vec3::min);
    let high = positions().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    let (middle, radius) = (0.5 * (low + high), (0.5 * (high - low).length()).max(1e-3));

    let half_tangent = (0.5 * view.fov_degrees.to_radians()).tan();
    let size = Vec2::new(view.width as f32, view.height as f32);
    let half_window = half_tangent * size / size.max_element();
    let target = view.target.unwrap_or(middle);
    let framing = Vec3::new(0.0, -1.0, 0.3).normalize() * radius / half_window.min_element().atan().sin();
    let eye = view.eye.unwrap_or(target + framing);
    let Some(forward) = (target - eye).try_normalize() else {
        return fail("the camera stands where it looks at; move one of them");
    };
    let upwards = if forward.z.abs() > 0.9999 { Vec3::Y } else { Vec3::Z };
    let right = forward.cross(upwards).normalize();
    let rotation = Mat3::from_cols(right, right.cross(forward), -forward);
    Ok(Camera {
        name: "Camera".into(),
        world_from_camera: Affine3A::from_mat3_translation(rotation, eye),
        width: view.width,
        height: view.height,
        window_min: -half_window,
        window_max: half_window,
        ..Camera::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(view: &ObjView) -> Result<Scene, SessionError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cube.obj");
        let corners = (0..8).map(|i| format!("v {} {} {}\n", i & 1, i >> 1 & 1, i >> 2));
        std::fs::write(&path, corners.collect::<String>() + "f 1 2 4 3\nf 5 6 8 7\nf 1 2 6 5\n").unwrap();
        obj_scene(&path, view)
    }

    #[test]
    fn whole_scene_is_in_the_frame() {
        for (width, height) in [(64, 64), (200, 50), (50, 200)] {
            let view = ObjView { width, height, up: UpAxis::Z, ..ObjView::default() };
            let scene = cube(&view).unwrap();
            let camera_from_world = scene.camera.world_from_camera.inverse();
            for corner in &scene.meshes[0].positions {
                let p = camera_from_world.transform_point3(*corner);
                let film = p.truncate() / -p.z;
                assert!(p.z < 0.0 && film.abs().cmple(scene.camera.window_max).all(), "{corner} at {film}");
            }
        }
    }

    #[test]
    fn middle_ray_meets_the_target() {
        let (eye, target) = (Vec3::new(3.0, 4.0, 5.0), Vec3::new(0.0, 1.0, 0.5));
        let view =
            ObjView { eye: Some(eye), target: Some(target), width: 3, height: 3, ..ObjView::default() };
        let (origin, direction) = cube(&view).unwrap().camera.pixel_ray(1, 1);
        assert!(origin.distance(eye) < 1e-5);
        assert!(direction.distance((target - eye).normalize()) < 1e-5);
    }

    #[test]
    fn impossible_cameras_are_refused() {
        let same = ObjView { eye: Some(Vec3::ONE), target: Some(Vec3::ONE), ..ObjView::default() };
        assert!(cube(&same).unwrap_err().to_string().contains("camera stands"));
        let wide = ObjView { fov_degrees: f32::NAN, ..ObjView::default() };
        assert!(cube(&wide).unwrap_err().to_string().contains("field of view"));
    }
}
