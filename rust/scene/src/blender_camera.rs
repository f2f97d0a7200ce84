//! Blender's camera settings to a film window, as Cycles computes it (`blender/camera.cpp`).

use crate::motion::keys_fault;
use crate::{Camera, DepthOfField, Pose, Projection, Shutter};
use glam::{Affine3A, Mat3, Vec2, Vec3};

/// A camera object of Blender with its camera data and the render settings that shape the film.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlenderCamera {
    /// Object name.
    pub name: String,
    /// Rows of the object's world matrix; its scale is ignored.
    pub world_from_object: [[f32; 4]; 4],
    /// `Camera.type` and `panorama_type`, with the settings of that.
    pub projection: Projection,
    /// Film size in pixels, after resolution percentage: width, height.
    pub resolution: [usize; 2],
    /// `RenderSettings.pixel_aspect_x`, `_y`.
    pub pixel_aspect: [f32; 2],
    /// `Camera.sensor_fit`.
    pub sensor_fit: SensorFit,
    /// `Camera.sensor_width`, `sensor_height`, millimetres.
    pub sensor: [f32; 2],
    /// `Camera.lens`, millimetres.
    pub lens: f32,
    /// `Camera.ortho_scale`, metres.
    pub ortho_scale: f32,
    /// `Camera.shift_x`, `shift_y`.
    pub shift: [f32; 2],
    /// `Camera.clip_start`, metres.
    pub clip_start: f32,
    /// `Camera.clip_end`, metres.
    pub clip_end: f32,
    /// Rows of its world matrix at each key of its motion; empty if it stands still.
    #[serde(default)]
    pub motion: Vec<[[f32; 4]; 4]>,
    /// Focal lengths when the shutter opens and when it closes, if they differ from `lens`, millimetres.
    #[serde(default)]
    pub zoom: Option<[f32; 2]>,
    /// Times at which it sees; nothing without motion blur.
    #[serde(default)]
    pub shutter: Option<Shutter>,
    /// Depth of field, if used.
    #[serde(default)]
    pub depth_of_field: Option<BlenderDepthOfField>,
}

/// `Camera.sensor_fit`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
#[expect(missing_docs, reason = "the names of Blender's enum")]
pub enum SensorFit {
    Auto,
    Horizontal,
    Vertical,
}

/// `Camera.dof`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BlenderDepthOfField {
    /// `aperture_fstop`.
    pub fstop: f32,
    /// Distance along the view axis, metres; of the focus object if there is one.
    pub focus_distance: f32,
    /// `aperture_blades`.
    pub blades: u32,
    /// `aperture_rotation`, radians.
    pub rotation: f32,
    /// `aperture_ratio`.
    pub ratio: f32,
}

/// A camera that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("camera '{camera}': {reason}")]
pub struct CameraError {
    /// Object name.
    pub camera: String,
    /// Fault and next step, in words.
    pub reason: &'static str,
}

/// Largest film edge, pixels.
const MAX_RESOLUTION: usize = 65_536;

impl BlenderCamera {
    /// The camera in physical units.
    pub fn to_camera(&self) -> Result<Camera, CameraError> {
        self.validate()?;
        let [width, height] = self.resolution;
        let (window_min, window_max) = self.window();
        let keys = self.motion.iter().map(|rows| self.world_from_camera(rows));
        Ok(Camera {
            name: self.name.clone(),
            world_from_camera: self.world_from_camera(&self.world_from_object)?,
            projection: match self.projection {
                Projection::Panoramic(panorama) => {
                    Projection::Panoramic(panorama.on_sensor(self.edges(self.fitted_sensor())))
                }
                planar => planar,
            },
            width,
            height,
            window_min,
            window_max,
            clip_start: self.clip_start,
            clip_end: self.clip_end,
            motion: Pose::keys(&keys.collect::<Result<Vec<_>, _>>()?),
            zoom: self.zoom.map(|lenses| lenses.map(|lens| self.lens / lens)),
            shutter: self.shutter.clone(),
            depth_of_field: self.depth_of_field.map(|dof| self.lens_of(dof)),
        })
    }

    /// Size of the sensor's edge that fits the film, millimetres.
    fn fitted_sensor(&self) -> f32 {
        if self.sensor_fit == SensorFit::Vertical { self.sensor[1] } else { self.sensor[0] }
    }

    /// Width and height of a film whose fitted edge has this length; the other edge follows the aspect ratio.
    fn edges(&self, fitted: f32) -> Vec2 {
        let size = Vec2::new(self.resolution[0] as f32, self.resolution[1] as f32);
        let aspect = size * Vec2::from_array(self.pixel_aspect);
        let horizontal = match self.sensor_fit {
            SensorFit::Auto => aspect.x > aspect.y,
            SensorFit::Horizontal => true,
            SensorFit::Vertical => false,
        };
        match horizontal {
            true => Vec2::new(fitted, fitted * aspect.y / aspect.x),
            false => Vec2::new(fitted * aspect.x / aspect.y, fitted),
        }
    }

    /// Film window on the plane z = -1 (perspective), in metres (orthographic) or of 0..1 and shifted (panoramic).
    fn window(&self) -> (Vec2, Vec2) {
        if let Projection::Panoramic(_) = self.projection {
            let shift = Vec2::from_array(self.shift);
            return (shift, shift + 1.0);
        }
        // Half of the fitted edge.
        let half_fit = match self.projection {
            Projection::Orthographic => 0.5 * self.ortho_scale,
            _ => 0.5 * self.fitted_sensor() / self.lens,
        };
        let half = self.edges(half_fit);
        let shift = Vec2::from_array(self.shift) * 2.0 * half_fit;
        (shift - half, shift + half)
    }

    fn lens_of(&self, dof: BlenderDepthOfField) -> DepthOfField {
        let fstop = dof.fstop.max(1e-5);
        let diameter = match self.projection {
            Projection::Orthographic => 1.0 / fstop,
            _ => self.lens * 1e-3 / fstop,
        };
        DepthOfField {
            aperture_radius: 0.5 * diameter,
            focus_distance: dof.focus_distance,
            blades: dof.blades,
            rotation_rad: dof.rotation,
            ratio: dof.ratio,
        }
    }

    fn world_from_camera(&self, rows: &[[f32; 4]; 4]) -> Result<Affine3A, CameraError> {
        let column = |c: usize| Vec3::from_array(std::array::from_fn(|row| rows[row][c]));
        let axis = |c: usize| {
            column(c).try_normalize().ok_or_else(|| self.error("its scale is zero; set a scale above zero"))
        };
        Ok(Affine3A::from_mat3_translation(Mat3::from_cols(axis(0)?, axis(1)?, axis(2)?), column(3)))
    }

    fn validate(&self) -> Result<(), CameraError> {
        let sizes = [self.sensor[0], self.sensor[1], self.lens, self.ortho_scale];
        let settings = [self.clip_start, self.clip_end, self.shift[0], self.shift[1]];
        let matrices = [&self.world_from_object].into_iter().chain(&self.motion);
        let mut numbers = matrices.flatten().flatten().chain(&sizes).chain(&settings);
        if !numbers.all(|n| n.is_finite()) {
            return Err(self.error("a value is not a finite number; reset its transform and settings"));
        }
        if sizes
            .iter()
            .chain(&self.pixel_aspect)
            .chain(self.zoom.as_slice().as_flattened())
            .any(|size| size.is_nan() || *size <= 0.0)
        {
            return Err(self.error("lens, sensor, scale and pixel aspect must be above zero"));
        }
        if self.resolution.iter().any(|edge| !(1..=MAX_RESOLUTION).contains(edge)) {
            return Err(self.error("the picture must be 1 to 65536 pixels wide and high"));
        }
        if !(0.0 <= self.clip_start && self.clip_start < self.clip_end) {
            return Err(self.error("clip start must lie below clip end"));
        }
        let keys = keys_fault(self.motion.len());
        if let Some(reason) = keys.or_else(|| self.shutter.as_ref().and_then(Shutter::fault)) {
            return Err(self.error(reason));
        }
        if let Projection::Panoramic(panorama) = &self.projection
            && !panorama.on_sensor(Vec2::ONE).is_sound()
        {
            return Err(self.error("its panorama needs an angle of view, a lens and a sensor above zero"));
        }
        if let Some(dof) = self.depth_of_field
            && !(dof.focus_distance > 0.0 && dof.ratio > 0.0 && dof.fstop > 0.0 && dof.rotation.is_finite())
        {
            return Err(self.error("depth of field needs distance, f-stop and ratio above zero"));
        }
        Ok(())
    }

    fn error(&self, reason: &'static str) -> CameraError {
        CameraError { camera: self.name.clone(), reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> BlenderCamera {
        BlenderCamera {
            name: "Cam".into(),
            world_from_object: glam::Mat4::IDENTITY.to_cols_array_2d(),
            projection: Projection::Perspective,
            resolution: [1920, 1080],
            pixel_aspect: [1.0, 1.0],
            sensor_fit: SensorFit::Auto,
            sensor: [36.0, 24.0],
            lens: 50.0,
            ortho_scale: 6.0,
            shift: [0.0, 0.0],
            clip_start: 0.1,
            clip_end: 100.0,
            motion: Vec::new(),
            zoom: None,
            shutter: None,
            depth_of_field: None,
        }
    }

    #[test]
    fn wide_film_fits_the_sensor_width() {
        let c = camera().to_camera().unwrap();
        assert!((c.window_max - Vec2::new(0.36, 0.36 * 9.0 / 16.0)).length() < 1e-6);
        assert_eq!(c.window_min, -c.window_max);
    }

    #[test]
    fn tall_film_fits_the_sensor_width_vertically() {
        let c = BlenderCamera { resolution: [540, 1080], ..camera() }.to_camera().unwrap();
        assert!((c.window_max - Vec2::new(0.18, 0.36)).length() < 1e-6);
        let c = BlenderCamera { sensor_fit: SensorFit::Vertical, ..camera() }.to_camera().unwrap();
        assert!((c.window_max.y - 0.24).abs() < 1e-6);
    }

    #[test]
    fn shift_is_in_units_of_the_fitted_edge() {
        let c = BlenderCamera { shift: [0.25, -0.5], ..camera() }.to_camera().unwrap();
        let center = 0.5 * (c.window_min + c.window_max);
        assert!((center - Vec2::new(0.18, -0.36)).length() < 1e-6);
    }

    #[test]
    fn lenses_of_panoramas_show_what_the_fitted_sensor_does() {
        let fisheye = crate::Panorama::FisheyeEquisolid { lens: 10.5, fov: 3.0, sensor: [0.0; 2] };
        let panoramic = BlenderCamera { projection: Projection::Panoramic(fisheye), ..camera() };
        for (resolution, sensor_fit, expected) in [
            ([32, 20], SensorFit::Auto, [36.0, 22.5]),
            ([32, 20], SensorFit::Vertical, [38.4, 24.0]),
            ([20, 32], SensorFit::Auto, [22.5, 36.0]),
            ([20, 32], SensorFit::Horizontal, [36.0, 57.6]),
        ] {
            let fitted = BlenderCamera { resolution, sensor_fit, shift: [0.1, 0.2], ..panoramic.clone() };
            let c = fitted.to_camera().unwrap();
            let Projection::Panoramic(crate::Panorama::FisheyeEquisolid { sensor, .. }) = c.projection else {
                panic!("another projection")
            };
            assert!((Vec2::from(sensor) - Vec2::from(expected)).length() < 1e-4, "{sensor:?}");
            assert_eq!((c.window_min, c.window_max), (Vec2::new(0.1, 0.2), Vec2::new(1.1, 1.2)));
        }
    }

    #[test]
    fn orthographic_scale_is_the_longer_edge() {
        let c = BlenderCamera { projection: Projection::Orthographic, ..camera() }.to_camera().unwrap();
        assert!((c.window_max - Vec2::new(3.0, 3.0 * 9.0 / 16.0)).length() < 1e-6);
    }

    #[test]
    fn aperture_is_half_the_focal_length_over_the_f_number() {
        let dof =
            BlenderDepthOfField { fstop: 2.0, focus_distance: 3.0, blades: 6, rotation: 0.0, ratio: 1.0 };
        let c = BlenderCamera { depth_of_field: Some(dof), ..camera() }.to_camera().unwrap();
        assert!((c.depth_of_field.unwrap().aperture_radius - 0.0125).abs() < 1e-9);
    }

    #[test]
    fn damage_is_refused_by_name() {
        for broken in [
            BlenderCamera { lens: 0.0, ..camera() },
            BlenderCamera { resolution: [0, 5], ..camera() },
            BlenderCamera { clip_start: f32::NAN, ..camera() },
            BlenderCamera { clip_end: 0.05, ..camera() },
            BlenderCamera { zoom: Some([50.0, 0.0]), ..camera() },
            BlenderCamera { motion: vec![camera().world_from_object; 2], ..camera() },
            BlenderCamera {
                projection: Projection::Panoramic(crate::Panorama::FisheyeEquidistant { fov: 0.0 }),
                ..camera()
            },
            BlenderCamera { world_from_object: [[0.0; 4]; 4], ..camera() },
        ] {
            assert!(broken.to_camera().unwrap_err().to_string().contains("'Cam'"));
        }
    }
}
