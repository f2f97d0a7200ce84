use relume_image::Image;
use relume_optimise::{Goal, Relight, View};
use relume_scene::Light;
use std::sync::Arc;

use super::gather_relight::{GatherRelight, Prepared};
use super::lights::{Picture, Unknowns};
use super::{SolveRequest, Through};
use crate::error::SessionError;
use crate::progress::Monitor;
use crate::relight::relighter::{RelightOptions, Relighter};

/// One view: what is there besides the lights to be solved, in pictures of the size that the solver looks at.
pub(crate) struct SceneView<'a> {
    pub(super) relighter: &'a Relighter,
    pub(super) source: Source,
    pub(super) goals: Vec<Goal>,
    /// Static light, world and lights that stay.
    base: Image,
    /// Pictures for radiance 1 of lights of which only colour or strength may change.
    still: Vec<Option<Arc<Image>>>,
    /// All as it is now.
    pub(super) before: Looks,
}

/// A light's picture for radiance 1.
pub(super) struct Unit {
    /// Without noise.
    pub clean: Arc<Image>,
    /// As it was gathered; the clean one where there is no noise.
    pub exact: Arc<Image>,
}

/// A picture of a view.
#[derive(Default)]
pub(super) struct Looks {
    /// Without noise.
    pub clean: Image,
    /// With the lights that move as they were gathered: noisy, but right on average, which what is denoised is not quite.
    pub exact: Image,
}

impl Looks {
    fn add_scaled(&mut self, clean: &Image, exact: &Image, factor: &[f32; 3]) {
        self.clean.add_scaled(clean, factor);
        self.exact.add_scaled(exact, factor);
    }
}

/// All views.
pub(super) struct Scenes<'a> {
    /// By their bakes, where each has one.
    pub gathered: Option<Vec<SceneView<'a>>>,
    /// By proxies, if lights are solved through them.
    pub proxied: Option<Vec<SceneView<'a>>>,
}

impl<'a> Scenes<'a> {
    /// With goals of each view for pictures of the whole size.
    pub fn new(
        relighters: &[&'a Relighter],
        request: &SolveRequest,
        unknowns: &Unknowns,
        goals: &[Vec<Goal>],
        through: Through,
        monitor: &Monitor,
    ) -> Result<Self, SessionError> {
        let views = |sources: Vec<Source>| -> Result<Vec<SceneView<'a>>, SessionError> {
            let views = relighters.iter().zip(sources).zip(goals);
            let view = |((relighter, source), goals): ((&&'a Relighter, Source), &Vec<Goal>)| {
                SceneView::new(relighter, source, request, unknowns, goals, monitor)
            };
            views.map(view).collect()
        };
        let bake = |(relighter, goals): (&&Relighter, &Vec<Goal>)| {
            Some(Source::Bake(Box::new(Prepared::new(relighter, goals, monitor)?)))
        };
        let bakes: Option<Vec<Source>> = relighters.iter().zip(goals).map(bake).collect();
        let proxies =
            (through == Through::Proxy).then(|| relighters.iter().map(|_| Source::Proxies).collect());
        Ok(Self { gathered: bakes.map(views).transpose()?, proxied: proxies.map(views).transpose()? })
    }

    /// Those by which is told what became of the goals.
    pub fn told(&self) -> &[SceneView<'a>] {
        self.gathered.as_ref().or(self.proxied.as_ref()).map_or(&[], Vec::as_slice)
    }
}

/// What makes a view's pictures.
pub(super) enum Source {
    /// The bake, which looks at smaller ones: what is compared are means of cells, and denoising costs by the pixel.
    Bake(Box<Prepared>),
    /// Proxies, and the bake where there is one for what none covers, of each pixel.
    Proxies,
}

impl Source {
    /// Static light and world.
    fn statics(&self, relighter: &Relighter, monitor: &Monitor) -> Result<[Image; 2], SessionError> {
        match self {
            Self::Bake(prepared) => prepared.statics(relighter),
            Self::Proxies => {
                relighter.statics(relighter.possible(&RelightOptions::default(), monitor).denoise)
            }
        }
    }

    /// Lights for radiance 1.
    fn units(
        &self,
        relighter: &Relighter,
        lights: &[Light],
        monitor: &Monitor,
    ) -> Result<Vec<Unit>, SessionError> {
        match self {
            Self::Bake(prepared) => prepared.units(relighter, lights, monitor),
            Self::Proxies => {
                let options = relighter.possible(&RelightOptions::default(), monitor);
                let units = relighter.unit_images(lights, &options, monitor)?;
                let unit = |unit: Arc<Image>| Unit { clean: Arc::clone(&unit), exact: unit };
                Ok(units.into_iter().map(|(image, _)| unit(image)).collect())
            }
        }
    }
}

impl<'a> SceneView<'a> {
    fn new(
        relighter: &'a Relighter,
        source: Source,
        request: &SolveRequest,
        unknowns: &Unknowns,
        goals: &[Goal],
        monitor: &Monitor,
    ) -> Result<Self, SessionError> {
        let camera = relighter.camera();
        let goals = match &source {
            Source::Bake(prepared) => goals
                .iter()
                .map(|goal| goal.shrunk((camera.width, camera.height), prepared.shrink()))
                .collect(),
            Source::Proxies => goals.to_vec(),
        };
        let now = &request.now;
        let [static_light, world] = source.statics(relighter, monitor)?;
        let mut base = Image::new(world.width, world.height, 3);
        base.add_scaled(&static_light, &now.static_light);
        if unknowns.world.is_none() {
            base.add_scaled(&world, &now.world);
        }
        let stays = |(number, _): &(usize, &Light)| !unknowns.solves(*number);
        let staying: Vec<Light> =
            now.lights.iter().enumerate().filter(stays).map(|(_, light)| light.clone()).collect();
        for (light, unit) in staying.iter().zip(source.units(relighter, &staying, monitor)?) {
            base.add_scaled(&unit.clean, &light.radiance);
        }
        let held: Vec<Light> = unknowns.held().cloned().collect();
        let mut units = source.units(relighter, &held, monitor)?.into_iter();
        let world = Arc::new(world);
        let still = unknowns.pictures().map(|place| match place {
            Picture::Moves => None,
            Picture::World => Some(Arc::clone(&world)),
            Picture::Held => units.next().map(|unit| unit.clean),
        });
        let still = still.collect();
        let mut view = Self { relighter, source, goals, base, still, before: Looks::default() };
        let lights: Vec<Light> = unknowns.variables.iter().map(|variable| variable.light.clone()).collect();
        view.before = view.picture(&lights, monitor)?;
        Ok(view)
    }

    /// The view with these in the places of the lights to be solved.
    pub fn picture(&self, lights: &[Light], monitor: &Monitor) -> Result<Looks, SessionError> {
        let mut sum = Looks { clean: self.base.clone(), exact: self.base.clone() };
        let is_lit = |(light, still): &(&Light, &Option<_>)| still.is_none() && light.radiance != [0.0; 3];
        let moving: Vec<Light> =
            lights.iter().zip(&self.still).filter(is_lit).map(|(light, _)| light.clone()).collect();
        for (light, unit) in moving.iter().zip(self.source.units(self.relighter, &moving, monitor)?) {
            sum.add_scaled(&unit.clean, &unit.exact, &light.radiance);
        }
        for (light, still) in lights.iter().zip(&self.still) {
            still.iter().for_each(|unit| sum.add_scaled(unit, unit, &light.radiance));
        }
        Ok(sum)
    }

    /// What solves it through its bake, where it looks at that.
    pub fn by_gather(&self, monitor: &'a Monitor) -> Option<GatherRelight<'_>> {
        let Source::Bake(prepared) = &self.source else { return None };
        GatherRelight::new(self.relighter, prepared, monitor)
    }

    /// As the solver takes it, whose lights this makes.
    pub fn view<'b>(&'b self, relight: &'b dyn Relight) -> View<'b> {
        let still = self.still.iter().map(Option::as_deref).collect();
        View { relight, base: &self.base, still, goals: &self.goals }
    }

    /// Width and height of its pictures.
    pub fn size(&self) -> (usize, usize) {
        (self.base.width, self.base.height)
    }
}
