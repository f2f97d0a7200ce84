//! The world: radiance of rays that leave the scene, and directions sampled where an environment texture is bright.

use std::f32::consts::{PI, TAU};

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;
use relume_dump::Lobe;
use relume_scene::{MOST_RADIANCE, Scene};

use crate::{
    discrete::Discrete1D,
    shading::{PreparedMaterials, equirectangular},
};

/// Most columns of the grid that directions are sampled from.
const GRID_COLUMNS: usize = 1024;

/// Radiance by direction.
#[derive(Debug)]
pub(crate) struct EnvironmentLight {
    /// Radiance, or factor on the texture.
    color: Vec3,
    texture: Option<usize>,
    texture_from_world: Mat3,
    /// Kinds of rays that see it, by [`Lobe`].
    rays: [bool; 5],
    /// What other rays see.
    parts: Vec<Self>,
    grid: Option<DensityGrid>,
}

/// Piecewise constant density over the texture's plane.
#[derive(Debug)]
struct DensityGrid {
    cells: Discrete1D,
    columns: usize,
    rows: usize,
}

impl EnvironmentLight {
    /// The world of a scene, with a colour that may be another one than the scene's.
    pub fn new(scene: &Scene, color: [f32; 3], materials: &PreparedMaterials) -> Self {
        let world = &scene.world;
        let transform = world.texture_from_world;
        let color = Vec3::from(color);
        // Densities are computed for rotations (and mirrored ones) only; others are left to BSDF sampling.
        let is_rotation = (transform * transform.transpose()).abs_diff_eq(Mat3::IDENTITY, 1e-4);
        let rays = world.rays();
        // A light sample has no kind: it serves worlds that all rays but the camera's see alike.
        let is_one = rays[1..].iter().all(|sees| *sees);
        let texture = world.texture.filter(|_| is_rotation && is_one && color != Vec3::ZERO);
        let grid = texture.and_then(|index| DensityGrid::new(scene, materials, index));
        let parts = world.parts.iter().map(|part| Self {
            color: part.color.into(),
            texture: part.texture,
            texture_from_world: part.texture_from_world,
            rays: part.rays,
            parts: Vec::new(),
            grid: None,
        });
        Self {
            color,
            texture: world.texture,
            texture_from_world: transform,
            rays,
            parts: parts.collect(),
            grid,
        }
    }

    /// Radiance from the unit `direction` for rays of a kind, as far as it can be summed.
    pub fn radiance(
        &self,
        scene: &Scene,
        materials: &PreparedMaterials,
        direction: Vec3,
        lobe: Lobe,
    ) -> Vec3 {
        let kind = lobe.ray_kind() as usize;
        if !self.rays[kind] {
            let part = self.parts.iter().find(|part| part.rays[kind]);
            return part.map_or(Vec3::ZERO, |part| part.radiance(scene, materials, direction, lobe));
        }
        if self.color == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let texel = materials.world_texel(scene, self.texture, self.texture_from_world * direction);
        (self.color * texel).min(Vec3::splat(MOST_RADIANCE))
    }

    /// True if sampling directions directly is worth it: a world of one colour is as well met by BSDF sampling.
    pub fn can_sample(&self) -> bool {
        self.grid.is_some()
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

    /// Density of [`EnvironmentLight::sample`].
    pub fn density(&self, direction: Vec3) -> f32 {
        let Some(grid) = &self.grid else { return 0.0 };
        let coords = Vec2::from(equirectangular((self.texture_from_world * direction).normalize_or(Vec3::Z)));
        let column = ((coords.x * grid.columns as f32) as usize).min(grid.columns - 1);
        let row = ((coords.y * grid.rows as f32) as usize).min(grid.rows - 1);
        grid.density(row * grid.columns + column, coords.y)
    }
}

impl DensityGrid {
    fn new(scene: &Scene, materials: &PreparedMaterials, texture: usize) -> Option<Self> {
        let (width, height) = (scene.textures[texture].width, scene.textures[texture].height);
        let (columns, rows) = (width.min(GRID_COLUMNS), height.min(GRID_COLUMNS / 2));
        if columns == 0 || rows == 0 {
            return None;
        }
        // Each texel counts, so that a sun of one texel is not missed.
        let row_weights = |row: usize| {
            let mut weights = vec![0.0; columns];
            for y in row * height / rows..(row + 1) * height / rows {
                let v = (y as f32 + 0.5) / height as f32;
                for x in 0..width {
                    let u = (x as f32 + 0.5) / width as f32;
                    let brightness = materials.texel(scene, texture, [u, v]).max_element().clamp(0.0, 1e6);
                    weights[x * columns / width] += brightness * (PI * (v - 0.5)).cos();
                }
            }
            weights
        };
        let mut weights: Vec<f32> = (0..rows).into_par_iter().flat_map_iter(row_weights).collect();
        // Interpolation spreads an eighth of a texel's light into each neighbour.
        let (spread_x, spread_y) = (columns as f32 / width as f32 / 8.0, rows as f32 / height as f32 / 8.0);
        weights = spread(&weights, spread_x, |cell, step| {
            let x = (cell % columns + columns).wrapping_add_signed(step) % columns;
            cell - cell % columns + x
        });
        weights = spread(&weights, spread_y, |cell, step| {
            let y = (cell / columns).saturating_add_signed(step).min(rows - 1);
            y * columns + cell % columns
        });
        Some(Self { cells: Discrete1D::new(&weights)?, columns, rows })
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

/// Gives `share` of each cell to both of its neighbours.
fn spread(weights: &[f32], share: f32, neighbour: impl Fn(usize, isize) -> usize) -> Vec<f32> {
    let around = |cell: usize| weights[neighbour(cell, -1)] + weights[neighbour(cell, 1)];
    (0..weights.len()).map(|cell| weights[cell] * (1.0 - 2.0 * share) + around(cell) * share).collect()
}

/// Inverse of [`equirectangular`].
fn from_equirectangular(coords: Vec2) -> Vec3 {
    let (sin_u, cos_u) = (-TAU * (coords.x - 0.5)).sin_cos();
    let (sin_v, cos_v) = (PI * (coords.y - 0.5)).sin_cos();
    Vec3::new(cos_v * cos_u, cos_v * sin_u, sin_v)
}

#[cfg(test)]
mod tests {
    use relume_scene::{Alpha, ColorEncoding, Texels, Texture, World, WorldPart};

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
                ..World::default()
            },
            ..Scene::default()
        }
    }

    #[test]
    fn directions_survive_the_round_trip() {
        for coords in [Vec2::new(0.1, 0.2), Vec2::new(0.7, 0.9), Vec2::new(0.5, 0.5)] {
            assert!((Vec2::from(equirectangular(from_equirectangular(coords))) - coords).length() < 1e-5);
        }
    }

    #[test]
    fn sampled_and_uniform_estimates_of_the_irradiance_agree() {
        let scene = scene();
        let materials = PreparedMaterials::new(&scene).0;
        let environment = EnvironmentLight::new(&scene, scene.world.color, &materials);
        assert!(environment.can_sample());
        let (mut sampled, mut uniform, mut differing) = (0.0_f64, 0.0_f64, 0);
        let count = 400_000;
        for i in 0..count {
            let step = f64::from(i);
            let u =
                [(step + 0.5) / f64::from(count), (step * 0.754_877_7).fract(), (step * 0.569_84).fract()];
            let u = u.map(|u| u as f32);
            // A number may round onto a pole, which has no density.
            let Some((direction, density)) = environment.sample(u) else { continue };
            let listed = environment.density(direction);
            differing += i32::from((density - listed).abs() > 1e-3 * density);
            sampled +=
                f64::from(environment.radiance(&scene, &materials, direction, Lobe::Diffuse).x / density);
            let z = 1.0 - 2.0 * u[0];
            let flat = Vec2::from_angle(TAU * u[1]) * (1.0 - z * z).sqrt();
            uniform += f64::from(environment.radiance(&scene, &materials, flat.extend(z), Lobe::Diffuse).x)
                * 4.0
                * std::f64::consts::PI;
        }
        assert!(differing < 20, "{differing} directions round into a neighbouring cell");
        assert!(
            (sampled / uniform - 1.0).abs() < 0.02,
            "{} {}",
            sampled / f64::from(count),
            uniform / f64::from(count)
        );
    }

    #[test]
    fn a_world_hidden_from_the_camera_is_black_to_it_alone() {
        let mut scene = scene();
        scene.world.visible_camera = false;
        let materials = PreparedMaterials::new(&scene).0;
        let environment = EnvironmentLight::new(&scene, scene.world.color, &materials);
        assert_eq!(environment.radiance(&scene, &materials, Vec3::X, Lobe::Camera), Vec3::ZERO);
        assert!(environment.radiance(&scene, &materials, Vec3::X, Lobe::Glossy).x > 0.0);
    }

    #[test]
    fn rays_of_each_kind_see_their_part() {
        let mut scene = scene();
        let part = |kind: usize, color: f32| WorldPart {
            rays: std::array::from_fn(|other| other == kind),
            color: [color; 3],
            texture: None,
            texture_from_world: Mat3::IDENTITY,
        };
        scene.world.parts = vec![part(0, 7.0)];
        let materials = PreparedMaterials::new(&scene).0;
        let seen = |scene: &Scene, lobe| {
            let environment = EnvironmentLight::new(scene, scene.world.color, &materials);
            (environment.radiance(scene, &materials, Vec3::X, lobe).x, environment.can_sample())
        };
        let usual = seen(&scene, Lobe::Diffuse).0;
        assert_eq!(seen(&scene, Lobe::Camera), (7.0, true));
        assert_eq!(seen(&scene, Lobe::Volume), (usual, true));
        scene.world.parts.push(part(2, 0.0));
        assert_eq!(seen(&scene, Lobe::Glossy), (0.0, false));
        assert_eq!(seen(&scene, Lobe::Transmission), (usual, false));
    }
}
