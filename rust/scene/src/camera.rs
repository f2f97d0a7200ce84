use glam::{Affine3A, Vec2, Vec3};

use crate::{Panorama, Pose, Shutter};

/// A Blender camera: looks down its local -z, +x right, +y up.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Camera {
    /// Object name, for messages and files.
    pub name: String,
    /// Rigid transform (scale removed) of the camera object.
    pub world_from_camera: Affine3A,
    /// Projection of the film to rays.
    pub projection: Projection,
    /// Film size in pixels, after resolution percentage.
    pub width: usize,
    /// See `width`.
    pub height: usize,
    /// Lower left corner of the film window on the plane z = -1 (perspective) or in metres (orthographic), in
    /// camera space; shift, sensor fit and pixel aspect are already applied. Panoramic films are 0..1.
    pub window_min: Vec2,
    /// Upper right corner, see `window_min`.
    pub window_max: Vec2,
    /// Rays start at this distance along -z, in metres; panoramic ones along themselves, also below.
    pub clip_start: f32,
    /// Rays end at this distance along -z, in metres.
    #[serde(deserialize_with = "null_as_infinity")]
    pub clip_end: f32,
    /// Its transform at each key of its motion, in the middle that of `world_from_camera`; empty if it stands still.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub motion: Vec<Pose>,
    /// Factors on the film window when the shutter opens and when it closes, of a lens that zooms; between them and the
    /// middle of the interval the window changes evenly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zoom: Option<[f32; 2]>,
    /// Times at which it sees; nothing where nothing moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shutter: Option<Shutter>,
    /// Thin lens, if used.
    pub depth_of_field: Option<DepthOfField>,
}

/// The kind of projection.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Projection {
    /// All rays leave the camera's position (or lens).
    Perspective,
    /// Parallel rays along -z.
    Orthographic,
    /// Rays in directions of their own, which leave the camera's position (or lens).
    Panoramic(Panorama),
}

/// Thin lens parameters as Cycles uses them.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DepthOfField {
    /// Radius of the lens in metres: focal length / (2 f-number), or half the inverse f-number for orthographic.
    pub aperture_radius: f32,
    /// Distance of the plane in focus along -z, in metres.
    pub focus_distance: f32,
    /// Number of blades; below 3 the lens is a disk.
    pub blades: u32,
    /// Rotation of the blades, radians.
    pub rotation_rad: f32,
    /// Anamorphic ratio: the lens is `1 / ratio` wide.
    pub ratio: f32,
}

impl Camera {
    /// Origin and unit direction of the ray through the middle of a pixel, world space, without lens or clipping; no
    /// direction where a lens shows nothing. Pixels count from the top left corner.
    pub fn pixel_ray(&self, x: usize, y: usize) -> (Vec3, Vec3) {
        let share =
            Vec2::new((x as f32 + 0.5) / self.width as f32, 1.0 - (y as f32 + 0.5) / self.height as f32);
        let film = self.window_min + share * (self.window_max - self.window_min);
        let (origin, direction) = match self.projection {
            Projection::Perspective => (Vec3::ZERO, film.extend(-1.0)),
            Projection::Orthographic => (film.extend(0.0), Vec3::NEG_Z),
            Projection::Panoramic(panorama) => (Vec3::ZERO, panorama.direction(film).unwrap_or_default()),
        };
        let world = &self.world_from_camera;
        (world.transform_point3(origin), world.transform_vector3(direction).normalize_or_zero())
    }
}

/// JSON has no infinity and writes null for it.
fn null_as_infinity<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    let value: Option<f32> = serde::Deserialize::deserialize(deserializer)?;
    Ok(value.unwrap_or(f32::INFINITY))
}

impl Default for Camera {
    fn default() -> Self {
        Self {
            name: "Camera".into(),
            world_from_camera: Affine3A::IDENTITY,
            projection: Projection::Perspective,
            width: 64,
            height: 64,
            window_min: Vec2::splat(-0.5),
            window_max: Vec2::splat(0.5),
            clip_start: 0.0,
            clip_end: f32::INFINITY,
            motion: Vec::new(),
            zoom: None,
            shutter: None,
            depth_of_field: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Quat;

    fn camera() -> Camera {
        // At (0, -5, 2), looking along +y.
        let rotation = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
        let place = Affine3A::from_rotation_translation(rotation, Vec3::new(0.0, -5.0, 2.0));
        Camera {
            world_from_camera: place,
            width: 4,
            height: 2,
            window_min: Vec2::new(-1.0, -0.5),
            window_max: Vec2::new(1.0, 0.5),
            ..Camera::default()
        }
    }

    #[test]
    fn first_pixel_is_top_left() {
        let (origin, direction) = camera().pixel_ray(0, 0);
        assert_eq!(origin, Vec3::new(0.0, -5.0, 2.0));
        let expected = Vec3::new(-0.75, 1.0, 0.25).normalize();
        assert!(direction.distance(expected) < 1e-6, "{direction}");
    }

    #[test]
    fn orthographic_rays_are_parallel_and_start_on_the_film() {
        let camera = Camera { projection: Projection::Orthographic, ..camera() };
        let (origin, direction) = camera.pixel_ray(3, 1);
        assert!(origin.distance(Vec3::new(0.75, -5.0, 1.75)) < 1e-6, "{origin}");
        assert!(direction.distance(Vec3::Y) < 1e-6);
    }

    #[test]
    fn unlimited_camera_survives_json() {
        let json = serde_json::to_string(&Camera::default()).unwrap();
        assert_eq!(serde_json::from_str::<Camera>(&json).unwrap(), Camera::default());
    }
}
