use relume_image::Image;
use relume_optimise::{Goal, Relight, View};
use relume_scene::Light;
use std::sync::Arc;

use super::gather_relight::{GatherRelight, SolveDump};
use super::lights::{Unknowns, VariablePicture};
use super::{Backend, SolveRequest};
use crate::error::SessionError;
use crate::progress::Monitor;
use crate::relight::options::RelightOptions;
use crate::relight::relighter::Relighter;

/// View with all that is there besides the lights to be solved, in pictures of the size that is compared.
pub(crate) struct SceneView<'a> {
    pub(super) relighter: &'a Relighter,
    pub(super) source: ViewSource,
    pub(super) goals: Vec<Goal>,
    /// Static light, world and lights that stay.
    base: Image,
    /// Pictures for radiance 1 of lights of which only colour or strength may change.
    still: Vec<Option<Arc<Image>>>,
    /// Present picture.
    pub(super) before: ViewPictures,
    /// True if all lights that move are connected, so that their clean pictures are right.
    pub(super) is_connected: bool,
}

/// A light's picture for radiance 1.
pub(super) struct UnitPictures {
    /// Picture without noise.
    pub clean: Arc<Image>,
    /// Sum as it was gathered; the clean one if it has no noise.
    pub exact: Arc<Image>,
}

/// A picture of a view.
#[derive(Default)]
pub(super) struct ViewPictures {
    /// Picture without noise.
    pub clean: Image,
    /// Picture with the moving lights as gathered: noisy, but right on average, unlike denoised ones.
    pub exact: Image,
}

impl ViewPictures {
    fn add_scaled(&mut self, clean: &Image, exact: &Image, factor: &[f32; 3]) {
        self.clean.add_scaled(clean, factor);
        self.exact.add_scaled(exact, factor);
    }
}

/// Views of the scene.
pub(super) struct Scenes<'a> {
    /// Views by their bakes, if each has one.
    pub gathered: Option<Vec<SceneView<'a>>>,
    /// Views by proxies, if lights are solved through them.
    pub proxied: Option<Vec<SceneView<'a>>>,
}

impl<'a> Scenes<'a> {
    /// Opens all views, with goals of full size.
    pub fn new(
        relighters: &[&'a Relighter],
        request: &SolveRequest,
        unknowns: &Unknowns,
        goals: &[Vec<Goal>],
        backend: Backend,
        monitor: &Monitor,
    ) -> Result<Self, SessionError> {
        let views = |sources: Vec<ViewSource>| -> Result<Vec<SceneView<'a>>, SessionError> {
            let views = relighters.iter().zip(sources).zip(goals);
            let view = |((relighter, source), goals): ((&&'a Relighter, ViewSource), &Vec<Goal>)| {
                SceneView::new(relighter, source, request, unknowns, goals, monitor)
            };
            views.map(view).collect()
        };
        let bake = |(relighter, goals): (&&Relighter, &Vec<Goal>)| {
            Some(ViewSource::Bake(Box::new(SolveDump::new(relighter, goals, monitor)?)))
        };
        let bakes: Option<Vec<ViewSource>> = relighters.iter().zip(goals).map(bake).collect();
        let proxies =
            (backend == Backend::Proxy).then(|| relighters.iter().map(|_| ViewSource::Proxies).collect());
        Ok(Self { gathered: bakes.map(views).transpose()?, proxied: proxies.map(views).transpose()? })
    }

    /// Views that judge the goals.
    pub fn judging(&self) -> &[SceneView<'a>] {
        self.gathered.as_ref().or(self.proxied.as_ref()).map_or(&[], Vec::as_slice)
    }
}

/// Source of a view's pictures.
pub(super) enum ViewSource {
    /// Bake, with smaller pictures: means of cells are compared, and denoising costs by the pixel.
    Bake(Box<SolveDump>),
    /// Proxies, and the bake where there is one for what none covers, of each pixel.
    Proxies,
}

impl ViewSource {
    /// Static light and world.
    fn statics(&self, relighter: &Relighter, monitor: &Monitor) -> Result<[Image; 2], SessionError> {
        match self {
            Self::Bake(prepared) => prepared.statics(relighter),
            Self::Proxies => relighter
                .statics(relighter.without_missing_denoiser(&RelightOptions::default(), monitor).denoise),
        }
    }

    /// Lights for radiance 1.
    fn units(
        &self,
        relighter: &Relighter,
        lights: &[Light],
        monitor: &Monitor,
    ) -> Result<Vec<UnitPictures>, SessionError> {
        match self {
            Self::Bake(prepared) => prepared.units(relighter, lights, monitor),
            Self::Proxies => {
                let options = relighter.without_missing_denoiser(&RelightOptions::default(), monitor);
                let units = relighter.unit_images(lights, &options, monitor)?;
                let unit = |unit: Arc<Image>| UnitPictures { clean: Arc::clone(&unit), exact: unit };
                Ok(units.into_iter().map(|(image, _)| unit(Arc::new(image))).collect())
            }
        }
    }
}

impl<'a> SceneView<'a> {
    fn new(
        relighter: &'a Relighter,
        source: ViewSource,
        request: &SolveRequest,
        unknowns: &Unknowns,
        goals: &[Goal],
        monitor: &Monitor,
    ) -> Result<Self, SessionError> {
        let camera = relighter.camera();
        let goals = match &source {
            ViewSource::Bake(prepared) => goals
                .iter()
                .map(|goal| goal.shrunk((camera.width, camera.height), prepared.shrink()))
                .collect(),
            ViewSource::Proxies => goals.to_vec(),
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
            VariablePicture::Moves => None,
            VariablePicture::World => Some(Arc::clone(&world)),
            VariablePicture::Held => units.next().map(|unit| unit.clean),
        });
        let still = still.collect();
        let is_connected = unknowns.moving().all(|light| relighter.connects(light));
        let before = ViewPictures::default();
        let mut view = Self { relighter, source, goals, base, still, before, is_connected };
        let lights: Vec<Light> = unknowns.variables.iter().map(|variable| variable.light.clone()).collect();
        view.before = view.picture(&lights, monitor)?;
        Ok(view)
    }

    /// The view with these in the places of the lights to be solved.
    pub fn picture(&self, lights: &[Light], monitor: &Monitor) -> Result<ViewPictures, SessionError> {
        let mut sum = ViewPictures { clean: self.base.clone(), exact: self.base.clone() };
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

    /// Relighter through its bake, if the view has one.
    pub fn by_gather(&self, monitor: &'a Monitor) -> Option<GatherRelight<'_>> {
        let ViewSource::Bake(prepared) = &self.source else { return None };
        GatherRelight::new(self.relighter, prepared, monitor)
    }

    /// View for the solver, with this relighter of lights.
    pub fn view<'b>(&'b self, relight: &'b dyn Relight) -> View<'b> {
        let still = self.still.iter().map(Option::as_deref).collect();
        View { relight, base: &self.base, still, goals: &self.goals }
    }

    /// Width and height of its pictures.
    pub fn size(&self) -> (usize, usize) {
        (self.base.width, self.base.height)
    }
}
