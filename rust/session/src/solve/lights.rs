use glam::Vec3;
use relume_optimise::{Bounds, Locks, Variable};
use relume_proxy::{HALF_ANGLES, LightKind};
use relume_scene::{Light, LightShape};
use std::mem::discriminant;

use super::request::{Answer, Backend, BoundsOptions, FreeParam, NewLightKind, SolveRequest};
use crate::bake::features::pixel_features;
use crate::error::SessionError;
use crate::live::LiveRequest;
use crate::relight::relighter::Relighter;

/// Half angles of a new spot's cone and of a new sun, radians, from which both can be found that are wider and narrower.
const NEW_CONE: f32 = 0.6;
const NEW_SUN: f32 = 0.05;

/// Light or world that a variable stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum VariableSource {
    /// A light of the request, by its number.
    Scene(usize),
    /// The world.
    World,
    /// An added light.
    New,
}

/// Source of a variable's picture for radiance 1.
pub(super) enum VariablePicture {
    /// Solved light whose shape may change: made at each step.
    Moves,
    /// The world's layer.
    World,
    /// Made once.
    Held,
}

/// The lights that are to be solved.
pub(super) struct Unknowns {
    pub variables: Vec<Variable>,
    pub sources: Vec<VariableSource>,
    /// Number of the variable that is the world.
    pub world: Option<usize>,
}

impl Unknowns {
    pub fn new(request: &SolveRequest, views: &[&Relighter]) -> Result<Self, SessionError> {
        let options = &request.options;
        let visible_in = |view: &&Relighter| pixel_features(view.aovs(), view.camera()).visible_bounds();
        let join = |(a, b): (Vec3, Vec3), (c, d): (Vec3, Vec3)| (a.min(c), b.max(d));
        let visible = views.iter().map(visible_in).reduce(join).unwrap_or_default();
        let prior_weight_of = |name: &str| {
            options
                .per_light
                .get(name)
                .and_then(|per_light| per_light.prior_weight)
                .unwrap_or(options.prior_weight)
        };
        let mut new = Self { variables: Vec::new(), sources: Vec::new(), world: None };
        for (i, light) in request.now.lights.iter().enumerate() {
            let locks = options.free.get(&light.name).map_or(Locks::ALL, |free| locks(free));
            let locks = Locks { proportion: request.has_one_size(&light.name), ..locks };
            if !locks.hold_all(&light.shape) {
                let bounds = bounds(&options.bounds_of(&light.name), light, visible)?;
                let stay = prior_weight_of(&light.name);
                new.push(
                    VariableSource::Scene(i),
                    Variable { light: light.clone(), locks, bounds, prior_weight: stay },
                );
            }
        }
        let world = options.free.get("world").map_or(Locks::ALL, |free| locks(free));
        if !(world.color && world.strength) {
            new.world = Some(new.variables.len());
            let locks = Locks { color: world.color, strength: world.strength, ..Locks::ALL };
            // Its picture is made already, so that its shape does not matter.
            let shape = LightShape::Sphere { center: Vec3::ZERO, radius: 1.0 };
            let light = Light { radiance: request.now.world, ..plain("world", shape) };
            let (bounds, stay) =
                (bounds(&options.bounds_of("world"), &light, visible)?, prior_weight_of("world"));
            new.push(VariableSource::World, Variable { light, locks, bounds, prior_weight: stay });
        }
        for _ in 0..options.add.map_or(0, |add| add.count) {
            let shape = new_shape(options.add.map_or(NewLightKind::Point, |add| add.kind), visible, views);
            let light = Light { radiance: [0.0; 3], ..plain("new light", shape) };
            let options = BoundsOptions { stops: None, degrees: None, ..options.bounds };
            let bounds = bounds(&options, &light, visible)?;
            new.push(
                VariableSource::New,
                Variable { light, locks: Locks::default(), bounds, prior_weight: 0.0 },
            );
        }
        Ok(new)
    }

    fn push(&mut self, source: VariableSource, variable: Variable) {
        self.sources.push(source);
        self.variables.push(variable);
    }

    /// Lights whose shapes may change.
    pub fn moving(&self) -> impl Iterator<Item = &Light> {
        let moves = |variable: &&Variable| !variable.locks.hold_shape(&variable.light.shape);
        self.variables.iter().filter(moves).map(|variable| &variable.light)
    }

    /// Lights of which only colour or strength may change.
    pub fn held(&self) -> impl Iterator<Item = &Light> {
        let pairs = self.variables.iter().zip(self.pictures());
        pairs
            .filter(|(_, picture)| matches!(picture, VariablePicture::Held))
            .map(|(variable, _)| &variable.light)
    }

    pub fn pictures(&self) -> impl Iterator<Item = VariablePicture> {
        self.variables.iter().zip(&self.sources).map(|(variable, source)| match source {
            VariableSource::World => VariablePicture::World,
            _ if variable.locks.hold_shape(&variable.light.shape) => VariablePicture::Held,
            _ => VariablePicture::Moves,
        })
    }

    /// True if a light of the request is among them.
    pub fn solves(&self, number: usize) -> bool {
        self.sources.contains(&VariableSource::Scene(number))
    }

    /// Starts: first the lights as they are with random new ones, then random places altogether.
    pub fn starts(&self, mut random: Vec<Vec<Light>>) -> Vec<Vec<Light>> {
        for (i, source) in self.sources.iter().enumerate() {
            if *source != VariableSource::New && !random.is_empty() {
                random[0][i] = self.variables[i].light.clone();
            }
        }
        random
    }

    /// Values of the unknowns in an earlier answer. Lights that it left out are dark; its new ones are those that are
    /// not there now.
    ///
    /// # Errors
    /// Names a light that is of another type there.
    pub fn of_answer(&self, now: &LiveRequest, answer: &Answer) -> Result<Vec<Light>, SessionError> {
        let named = |name: &str| answer.lights.iter().find(|light| light.name == name);
        let is_new = |light: &&Light| now.lights.iter().all(|known| known.name != light.name);
        let mut new = answer.lights.iter().filter(is_new);
        let found = self.sources.iter().zip(&self.variables).map(|(source, variable)| {
            let light = &variable.light;
            let found = match source {
                VariableSource::Scene(_) => named(&light.name),
                VariableSource::World => return Ok(Light { radiance: answer.world, ..light.clone() }),
                VariableSource::New => new.next(),
            };
            let is_other = |found: &Light| discriminant(&found.shape) != discriminant(&light.shape);
            match found {
                Some(found) if *source != VariableSource::New && is_other(found) => Err(SessionError::Settings(format!(
                    "\"from\": light '{}' is of another type than it is now; solve again without \"from\"",
                    light.name
                ))),
                found => Ok(found.cloned().unwrap_or_else(|| Light { radiance: [0.0; 3], ..light.clone() })),
            }
        });
        found.collect()
    }

    /// Lights of the request with solved ones in their places, new ones without names at the end; and the factor on the
    /// world.
    pub fn all_lights(&self, now: &LiveRequest, found: &[Light]) -> (Vec<Light>, [f32; 3]) {
        let (mut lights, mut world) = (now.lights.clone(), now.world);
        for (source, light) in self.sources.iter().zip(found) {
            match source {
                VariableSource::Scene(number) => lights[*number] = light.clone(),
                VariableSource::World => world = light.radiance,
                VariableSource::New => lights.push(light.clone()),
            }
        }
        (lights, world)
    }

    /// Variables that may be left out in the end.
    pub fn may_go(&self, scene_lights: bool) -> Vec<bool> {
        let may_go = |(source, variable): (&VariableSource, &Variable)| match source {
            VariableSource::New => true,
            VariableSource::World => false,
            VariableSource::Scene(_) => {
                let may_be_dark = variable.bounds.strength.is_none_or(|[least, _]| least <= 0.0);
                scene_lights && !variable.locks.strength && may_be_dark
            }
        };
        self.sources.iter().zip(&self.variables).map(may_go).collect()
    }

    /// Keeps moving lights to where proxies were trained.
    pub fn keep_inside_proxies(&mut self, relighters: &[&Relighter], backend: Backend) {
        if backend != Backend::Proxy {
            return;
        }
        for variable in &mut self.variables {
            let Some(kind) = LightKind::of_light(&variable.light) else { continue };
            for trained in relighters.iter().filter_map(|relighter| relighter.proxies().of(kind)) {
                let info = trained.proxy.info();
                let corner =
                    |end: usize| Vec3::from_array(std::array::from_fn(|i| info.trained_ranges[i][end]));
                let bounds = &mut variable.bounds;
                bounds.center_min = bounds.center_min.max(corner(0));
                bounds.center_max = bounds.center_max.min(corner(1));
                bounds.size = [bounds.size[0].max(info.size.min), bounds.size[1].min(info.size.max)];
                bounds.cone[0] = bounds.cone[0].max(HALF_ANGLES[0]);
            }
        }
    }
}

/// Bounds that were asked for. By default they hold the visible scene and a little beyond it, more above and below a
/// flat one. Sizes go from a two-hundredth to a fifth of it. The light itself is always inside.
fn bounds(options: &BoundsOptions, light: &Light, (low, high): (Vec3, Vec3)) -> Result<Bounds, SessionError> {
    let extent = low.distance(high).max(1e-3);
    let beyond = (0.3 * extent - 0.5 * (high - low)).max(Vec3::splat(0.02 * extent));
    let min = options.min.map_or(low - beyond, Vec3::from);
    let max = options.max.map_or(high + beyond, Vec3::from);
    let [small, large] = options.size.unwrap_or([extent / 200.0, extent / 5.0]);
    let is_box = min.is_finite() && max.is_finite() && min.cmplt(max).all();
    if !(is_box && 0.0 < small && small < large && large.is_finite()) {
        return Err(SessionError::Settings(format!(
            "\"bounds\" of light '{}' must hold something: each \"min\" below its \"max\" (here {min} and {max}), sizes \
             above 0 and rising",
            light.name
        )));
    }
    let usual = Bounds::new(min, max, [small, large]);
    let bounds =
        Bounds { sun: options.sun.unwrap_or(usual.sun), cone: options.cone.unwrap_or(usual.cone), ..usual };
    let bounds = bounds.including(light).around(light, options.stops, options.degrees.map(f32::to_radians));
    Ok(bounds.tinted(light, options.tint))
}

fn locks(free: &[FreeParam]) -> Locks {
    let is_locked = |value: FreeParam| !free.contains(&value);
    Locks {
        position: is_locked(FreeParam::Position),
        direction: is_locked(FreeParam::Direction),
        size: is_locked(FreeParam::Size),
        cone: is_locked(FreeParam::Cone),
        color: is_locked(FreeParam::Color),
        strength: is_locked(FreeParam::Strength),
        proportion: false,
    }
}

/// Shape of a new light: in the middle of what is seen, of a size that proxies know, facing down. A point light is
/// Blender's default, or a sphere if only spheres have a proxy.
fn new_shape(kind: NewLightKind, (low, high): (Vec3, Vec3), views: &[&Relighter]) -> LightShape {
    let (center, extent) = (0.5 * (low + high), low.distance(high).max(1e-3));
    let known =
        |kind: LightKind| views.iter().find_map(|view| Some(view.proxies().of(kind)?.proxy.info().size));
    let size = |kind: LightKind, usual: f32| known(kind).map_or(usual, |size| (size.min * size.max).sqrt());
    match kind {
        NewLightKind::Point
            if known(LightKind::Sphere).is_some() && known(LightKind::FacingDisk).is_none() =>
        {
            LightShape::Sphere { center, radius: size(LightKind::Sphere, 0.02 * extent) }
        }
        NewLightKind::Point => {
            LightShape::FacingDisk { center, radius: size(LightKind::FacingDisk, 0.02 * extent) }
        }
        NewLightKind::Area => {
            let edge = size(LightKind::Quad, 0.1 * extent);
            let (edge_u, edge_v) = (-edge * Vec3::X, edge * Vec3::Y);
            LightShape::Quad { center, edge_u, edge_v, spread: std::f32::consts::PI }
        }
        NewLightKind::Spot => LightShape::Spot {
            center,
            radius: size(LightKind::Spot, 0.02 * extent),
            axis: -Vec3::Z,
            half_angle: NEW_CONE,
            blend: 0.15,
            soft_falloff: true,
        },
        NewLightKind::Sun => LightShape::Sun { direction: Vec3::Z, half_angle: NEW_SUN },
    }
}

fn plain(name: &str, shape: LightShape) -> Light {
    Light { name: name.into(), ..Light::unit(shape) }
}
