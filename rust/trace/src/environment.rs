//! The world: radiance of rays that leave the scene, and directions sampled where an environment texture is bright.

use std::f32::consts::{PI, TAU};

use glam::{Mat3, Vec2, Vec3};
use relume_scene::{ColorEncoding, Scene, Texels, Texture};

use crate::distribution::Distribution;

/// Most columns of the grid that directions are sampled from.
const GRID_COLUMNS: usize = 1024;

/// Radiance by direction.
#[derive(Debug)]
pub(crate) struct Environment {
    color: Vec3,
    /// Index into [`Scene::textures`].
    texture: Option<usize>,
    texture_from_world: Mat3,
    visible_camera: bool,
    grid: Option<Grid>,
}

/// Piecewise constant density over the texture's plane.
#[derive(Debug)]
struct Grid {
    cells: Distribution,
    columns: usize,
    rows: usize,
}

impl Environment {
    pub fn new(scene: &Scene) -> Self {
        let world = &scene.world;
        let texture = world.texture.filter(|index| *index < scene.textures.len());
        let transform = world.texture_from_world;
        // Densities are computed for rotations (and mirrored ones) only; others are left to BSDF sampling.
        let is_rotation = (transform * transform.transpose()).abs_diff_eq(Mat3::IDENTITY, 1e-4);
        let grid = texture.filter(|_| is_rotation).and_then(|index| Grid::new(&scene.textures[index]));
        Self {
            color: Vec3::from(world.color),
            texture,
            texture_from_world: transform,
            visible_camera: world.visible_camera,
            grid,
        }
    }

    pub fn is_black(&self) -> bool {
        self.color == Vec3::ZERO
    }

    /// Radiance from the unit `direction`, for camera rays or others.
    pub fn radiance(&self, scene: &Scene, direction: Vec3, is_camera: bool) -> Vec3 {
        if self.is_black() || (is_camera && !self.visible_camera) {
            return Vec3::ZERO;
        }
        let Some(index) = self.texture else { return self.color };
        let coords = equirectangular((self.texture_from_world * direction).normalize_or(Vec3::Z));
        self.color * bilinear(&scene.textures[index], coords)
    }

    /// Whether sampling directions directly is worth it: a world of one colour is as well met by BSDF sampling.
    pub fn can_sample(&self) -> bool {
        self.grid.is_some() && !self.is_black()
    }

    /// A direction and its density over solid angle.
    pub fn sample(&self, u: [f32; 3]) -> Option<(Vec3, f32)> {
        let grid = self.grid.as_ref()?;
        let cell = grid.cells.sample(u[0]);
        let coords = (Vec2::new((cell % grid.columns) as f32, (cell / grid.columns) as f32)
            + Vec2::new(u[1], u[2]))
            / Vec2::new(grid.columns as f32, grid.rows as f32);
        let direction = (self.texture_from_world.transpose() * from_equirectangular(coords)).normalize();
        let density = grid.density(cell, coords.y);
        (density > 0.0).then_some((direction, density))
    }

    /// Density of [`Environment::sample`].
    pub fn density(&self, direction: Vec3) -> f32 {
        let Some(grid) = &self.grid else { return 0.0 };
        let coords = equirectangular((self.texture_from_world * direction).normalize_or(Vec3::Z));
        let column = ((coords.x * grid.columns as f32) as usize).min(grid.columns - 1);
        let row = ((coords.y * grid.rows as f32) as usize).min(grid.rows - 1);
        grid.density(row * grid.columns + column, coords.y)
    }
}

impl Grid {
    fn new(texture: &Texture) -> Option<Self> {
        if texture.width == 0 || texture.height == 0 {
            return None;
        }
        let columns = texture.width.min(GRID_COLUMNS);
        let rows = texture.height.min(GRID_COLUMNS / 2);
        let mut weights = vec![0.0; columns * rows];
        for y in 0..texture.height {
            let row = y * rows / texture.height;
            let elevation = PI * ((y as f32 + 0.5) / texture.height as f32 - 0.5);
            for x in 0..texture.width {
                let brightness = texel(texture, x, y).max_element().clamp(0.0, 1e6);
                weights[row * columns + x * columns / texture.width] += brightness * elevation.cos();
            }
        }
        Some(Self { cells: Distribution::new(&weights)?, columns, rows })
    }

    /// Density over solid angle: the cell's probability over its share of the plane and the plane's stretch.
    fn density(&self, cell: usize, v: f32) -> f32 {
        let stretch = TAU * PI * ((v - 0.5) * PI).cos();
        if stretch <= 0.0 {
            return 0.0;
        }
        self.cells.probability(cell) * (self.columns * self.rows) as f32 / stretch
    }
}

/// Texture coordinates of a direction, as in Cycles (`direction_to_equirectangular`).
fn equirectangular(direction: Vec3) -> Vec2 {
    let u = -direction.y.atan2(direction.x) / TAU + 0.5;
    let v = direction.z.atan2(direction.x.hypot(direction.y)) / PI + 0.5;
    Vec2::new(u, v)
}

/// Inverse of [`equirectangular`].
fn from_equirectangular(coords: Vec2) -> Vec3 {
    let (sin_u, cos_u) = (-TAU * (coords.x - 0.5)).sin_cos();
    let (sin_v, cos_v) = (PI * (coords.y - 0.5)).sin_cos();
    Vec3::new(cos_v * cos_u, cos_v * sin_u, sin_v)
}

/// Linear interpolation; the texture repeats around and ends at the poles.
fn bilinear(texture: &Texture, coords: Vec2) -> Vec3 {
    if texture.width == 0 || texture.height == 0 {
        return Vec3::ZERO;
    }
    let position = coords * Vec2::new(texture.width as f32, texture.height as f32) - 0.5;
    let base = position.floor();
    let fraction = position - base;
    let columns = [0, 1].map(|step| (base.x as i64 + step).rem_euclid(texture.width as i64) as usize);
    let rows = [0, 1].map(|step| (base.y as i64 + step).clamp(0, texture.height as i64 - 1) as usize);
    let row = |y: usize| texel(texture, columns[0], y).lerp(texel(texture, columns[1], y), fraction.x);
    row(rows[0]).lerp(row(rows[1]), fraction.y)
}

/// Scene-linear colour of a texel; black outside the data.
fn texel(texture: &Texture, x: usize, y: usize) -> Vec3 {
    let start = 4 * (y * texture.width + x);
    match &texture.texels {
        Texels::Float(values) => values.get(start..start + 3).map_or(Vec3::ZERO, Vec3::from_slice),
        Texels::Byte(values) => {
            let color = values.get(start..start + 3).map_or(Vec3::ZERO, |rgb| {
                Vec3::new(f32::from(rgb[0]), f32::from(rgb[1]), f32::from(rgb[2])) / 255.0
            });
            match texture.encoding {
                ColorEncoding::Linear => color,
                ColorEncoding::Srgb => color.map(linear_from_srgb),
            }
        }
    }
}

/// IEC 61966-2-1.
fn linear_from_srgb(value: f32) -> f32 {
    if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use relume_scene::{Alpha, World};

    use super::*;

    fn scene() -> Scene {
        let (width, height) = (32, 16);
        let mut values = vec![0.1; width * height * 4];
        // A small sun and a gradient.
        for (index, value) in values.iter_mut().enumerate() {
            *value += (index / 4 % width) as f32 * 0.01;
        }
        values[4 * (11 * width + 5)] = 500.0;
        let texture = Texture {
            name: "sky".into(),
            width,
            height,
            texels: Texels::Float(values),
            encoding: ColorEncoding::Linear,
            alpha: Alpha::None,
        };
        Scene {
            textures: vec![texture],
            world: World {
                color: [2.0, 2.0, 2.0],
                texture: Some(0),
                texture_from_world: Mat3::from_rotation_z(0.7),
                visible_camera: true,
            },
            ..Scene::default()
        }
    }

    #[test]
    fn directions_survive_the_round_trip() {
        for coords in [Vec2::new(0.1, 0.2), Vec2::new(0.7, 0.9), Vec2::new(0.5, 0.5)] {
            assert!((equirectangular(from_equirectangular(coords)) - coords).length() < 1e-5);
        }
        // +x is the middle of the image, +y a quarter to the left of it, +z the top row.
        assert!((equirectangular(Vec3::X) - Vec2::new(0.5, 0.5)).length() < 1e-6);
        assert!((equirectangular(Vec3::Y) - Vec2::new(0.25, 0.5)).length() < 1e-6);
        assert!((equirectangular(Vec3::Z).y - 1.0).abs() < 1e-6);
    }

    #[test]
    fn sampled_and_uniform_estimates_of_the_irradiance_agree() {
        let scene = scene();
        let environment = Environment::new(&scene);
        assert!(environment.can_sample());
        let (mut sampled, mut uniform, mut differing) = (0.0_f64, 0.0_f64, 0);
        let count = 400_000;
        for i in 0..count {
            let u = [
                (i as f32 + 0.5) / count as f32,
                (i as f32 * 0.754_877_7).fract(),
                (i as f32 * 0.569_84).fract(),
            ];
            // A number may round onto a pole, which has no density.
            let Some((direction, density)) = environment.sample(u) else { continue };
            let listed = environment.density(direction);
            differing += i32::from((density - listed).abs() > 1e-3 * density);
            sampled += f64::from(environment.radiance(&scene, direction, false).x / density);
            let z = 1.0 - 2.0 * u[0];
            let flat = Vec2::from_angle(TAU * u[1]) * (1.0 - z * z).sqrt();
            uniform +=
                f64::from(environment.radiance(&scene, flat.extend(z), false).x) * 4.0 * std::f64::consts::PI;
        }
        assert!(
            (sampled / uniform - 1.0).abs() < 0.02,
            "{} {}",
            sampled / count as f64,
            uniform / count as f64
        );
    }

    #[test]
    fn a_world_hidden_from_the_camera_is_black_to_it_alone() {
        let mut scene = scene();
        scene.world.visible_camera = false;
        let environment = Environment::new(&scene);
        assert_eq!(environment.radiance(&scene, Vec3::X, true), Vec3::ZERO);
        assert!(environment.radiance(&scene, Vec3::X, false).x > 0.0);
    }
}
