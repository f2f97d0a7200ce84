//! The way from one vertex of a path to the next, where there are media.

use glam::Vec3;
use relume_dump::{End, Lobe, Segment};

use super::{Features, Integrator, PathSink, Walk};
use crate::{
    bsdf::BsdfSample,
    bvh::{Ray, RayKind},
    media::{
        Bounds, Flight, HullCrossing, Landing, Media, MediaScratch, MediaSpace, TrackingNumbers, VolumeStack,
    },
    ray_offset::offset_origin,
    shading::{Hit, RayInfo, SurfacePoint},
};

/// Throughput below which a path may end where it is not scattered.
const FAINT: f32 = 0.05;

/// Squared distance in square metres up to which a portal leads to where it is.
const SAME_PLACE: f32 = 1e-9;

/// What a path meets next.
pub(super) enum Arrival {
    /// Nothing: it leaves the scene.
    Escape,
    /// A surface.
    Surface(Hit),
    /// A collision in a medium.
    Collision(Vec3),
    /// What it carries is absorbed.
    Lost,
}

/// Place of a path among the media.
#[derive(Clone, Debug)]
pub(super) struct Route {
    /// Media around the path's present ray.
    pub stack: VolumeStack,
    /// Start of the present segment.
    start: Vec3,
    /// End of the last record.
    recorded: Vec3,
    /// Way of a camera ray through hulls so far.
    pub travelled: f32,
    /// Length of the present ray's flight through these media.
    pub flight: f32,
}

impl Route {
    pub fn new(stack: VolumeStack, start: Vec3) -> Self {
        Self { stack, start, recorded: start, travelled: 0.0, flight: 0.0 }
    }

    /// Goes on with a record that another ray has added to.
    pub(super) fn continue_record(&mut self, other: &Self) {
        self.recorded = other.recorded;
    }

    /// Records a segment of a scene in which all space is filled: the part of it within the box outside of which positions are not
    /// stored. A record without weight leads to where it starts, if that is not where the last one ended.
    pub(super) fn record_within(&mut self, bounds: &Bounds, segment: Segment, sink: &mut impl PathSink) {
        let end = match segment.end {
            End::Vertex(end) => end,
            End::Escape(direction) => self.start + direction * bounds.reach(self.start),
        };
        let Some([from, to]) = bounds.clip(self.start, end) else { return };
        let is_apart = from != self.recorded;
        if is_apart {
            let way = Segment { end: End::Vertex(from), throughput: Vec3::ZERO, continues: false, ..segment };
            sink.push(way);
        }
        let end = match segment.end {
            End::Vertex(_) => End::Vertex(to),
            escape @ End::Escape(_) => escape,
        };
        sink.push(Segment { end, continues: segment.continues && !is_apart, ..segment });
        self.recorded = to;
    }
}

impl Integrator<'_> {
    /// The media as a ray finds them.
    pub(super) fn space<'s>(&'s self, media: &'s Media, time: f32, ray: RayInfo) -> MediaSpace<'s> {
        MediaSpace { scene: self.scene, materials: &self.materials, media, time, ray }
    }

    /// Media around a camera: one ray goes straight up, as in Cycles (`kernel/integrator/intersect_volume_stack.h`), and what it
    /// leaves without having entered it encloses the camera.
    pub(super) fn stack_at(&self, media: &Media, position: Vec3, time: f32) -> VolumeStack {
        let mut stack = media.outside();
        if !media.may_be_inside(position) {
            return stack;
        }
        let mut ray = Ray::new(position, Vec3::Z).at(time);
        let (mut crossing, mut entered) = (HullCrossing::default(), VolumeStack::default());
        while let Some(hit) = self.bvh.intersect(&ray).filter(|_| !crossing.is_worn_out()) {
            if hit.front.z > 0.0 {
                let was_entered = media.number(self.scene, (hit.instance, hit.primitive));
                if let Some(medium) = was_entered.filter(|medium| !entered.media().contains(medium)) {
                    stack.enter(medium);
                }
            } else {
                media.cross(self.scene, &hit, Vec3::Z, &mut entered);
            }
            crossing.pass(&mut ray, &hit);
        }
        stack
    }

    /// Starts the next segment where a path leaves a body that it went into.
    pub(super) fn leave_body(
        &self,
        walk: &mut Walk,
        entry: &SurfacePoint,
        exit: &SurfacePoint,
        sink: &mut impl PathSink,
    ) {
        // Lights inside the body do not count: this record only leads to where the next one starts.
        let (end, throughput) = (End::Vertex(exit.position), Vec3::ZERO);
        let receiver = self.scene.instances[entry.instance as usize].receiver;
        sink.push(Segment { end, throughput, lobe: Lobe::Diffuse, receiver, continues: false });
        walk.path.left_out = None;
        walk.begin_segment(exit.position);
        if let (Some(media), Some(route)) = (&self.media, &mut walk.route) {
            self.cross_media_in_body(media, entry, exit, &mut route.stack);
        }
    }

    /// Sends a path on at a position, along the direction of a sample. Only the path itself finds lights from there, as in Cycles.
    pub(super) fn jump(
        &self,
        walk: &mut Walk,
        point: &SurfacePoint,
        sample: &BsdfSample,
        position: Vec3,
        sink: &mut impl PathSink,
    ) {
        let segment = walk.path.segment(End::Vertex(position));
        sink.push(Segment { throughput: Vec3::ZERO, continues: false, ..segment });
        walk.path.jump(position, sample.weight, &self.settings.bounces);
        walk.ray = Ray { direction: sample.wi, t_min: 0.0, t_max: f32::INFINITY, ..walk.ray };
        if point.position.distance_squared(position) > SAME_PLACE {
            (walk.ray.origin, walk.ray.from) = (position, None);
        } else {
            offset_origin(&mut walk.ray, point);
        }
        walk.last = None;
        walk.begin_segment(position);
    }

    /// Takes a stack along the straight way through a body, into and out of the media of others that begin or end inside of it, as
    /// Cycles does (`kernel/integrator/intersect_volume_stack.h`). The body's own medium is not entered on this way.
    fn cross_media_in_body(
        &self,
        media: &Media,
        entry: &SurfacePoint,
        exit: &SurfacePoint,
        stack: &mut VolumeStack,
    ) {
        if ![entry, exit].into_iter().any(|point| media.may_be_inside(point.position)) {
            return;
        }
        let way = exit.position - entry.position;
        let direction = way.normalize_or_zero();
        let from = Some((entry.instance, entry.primitive));
        let mut ray = Ray { from, t_max: way.length(), ..Ray::new(entry.position, direction).at(entry.time) };
        let mut crossing = HullCrossing::default();
        while ray.t_max > 0.0
            && let Some(hit) = self.bvh.intersect(&ray).filter(|_| !crossing.is_worn_out())
        {
            if hit.instance != entry.instance {
                media.cross(self.scene, &hit, direction, stack);
            }
            crossing.pass(&mut ray, &hit);
        }
    }

    /// Goes on to the next vertex, through hulls and past collisions that change nothing but the weight.
    pub(super) fn travel(
        &self,
        media: &Media,
        walk: &mut Walk,
        features: &mut Features,
        mut numbers: TrackingNumbers,
        scratch: &mut MediaScratch,
        sink: &mut impl PathSink,
    ) -> Arrival {
        let mut crossing = HullCrossing::default();
        while !crossing.is_worn_out() {
            let hit = self.bvh.intersect(&walk.ray);
            if hit.is_none()
                && let Some(route) = &mut walk.route
            {
                route.stack = media.outside();
            }
            let length = hit.map_or(walk.ray.t_max, |hit| hit.distance);
            if let Some(arrival) = self.fly(media, walk, length, features, &mut numbers, scratch, sink) {
                return arrival;
            }
            let Some(hit) = hit else { return Arrival::Escape };
            if !media.is_hull(self.scene, &hit) {
                return Arrival::Surface(hit);
            }
            let direction = walk.ray.direction;
            let way = crossing.pass(&mut walk.ray, &hit);
            walk.footprint += walk.spread * way;
            if let Some(route) = &mut walk.route {
                media.cross(self.scene, &hit, direction, &mut route.stack);
                route.travelled += way;
            }
        }
        Arrival::Lost
    }

    /// Flies through the media of the present ray up to `length`; what is met there, if it gets no farther.
    fn fly(
        &self,
        media: &Media,
        walk: &mut Walk,
        length: f32,
        features: &mut Features,
        numbers: &mut TrackingNumbers,
        scratch: &mut MediaScratch,
        sink: &mut impl PathSink,
    ) -> Option<Arrival> {
        if let Some(route) = &mut walk.route {
            route.flight = length;
        }
        let scatters = !walk.path.is_last_surface() && walk.path.lights_only.is_none();
        let is_shadow = walk.ray.kind == RayKind::Shadow;
        if scatters && walk.counts && !is_shadow {
            sink.meet(|| self.flight_vertex(walk, media));
        }
        let mut flown = 0.0;
        loop {
            let Ray { origin, direction, time, .. } = walk.ray;
            let at = |distance: f32| origin + direction * distance;
            let stack = &walk.route.as_ref()?.stack;
            let left = length - flown;
            let ray = if is_shadow { walk.path.shadow_info() } else { walk.path.ray_info() };
            let space = self.space(media, time, ray);
            let flight = Flight { space, stack, origin: at(flown), direction, length: left };
            let throughput = walk.path.throughput;
            let (landing, emission) = flight.run(throughput, scatters, numbers, scratch);
            features.sample.emission += throughput * emission;
            match landing {
                Landing::Through => return None,
                Landing::Lost { distance } => {
                    self.record(walk, End::Vertex(at(flown + distance)), sink);
                    return Some(Arrival::Lost);
                }
                Landing::Scattered { distance, weight } => {
                    let position = at(flown + distance);
                    self.record(walk, End::Vertex(position), sink);
                    walk.path.throughput *= weight;
                    return Some(Arrival::Collision(position));
                }
                Landing::Changed { distance, weight } => {
                    flown += distance;
                    self.record(walk, End::Vertex(at(flown)), sink);
                    walk.path.change(weight);
                    walk.begin_segment(at(flown));
                    let survival = (walk.path.throughput.max_element() / FAINT).min(1.0);
                    if numbers.next() >= survival {
                        return Some(Arrival::Lost);
                    }
                    walk.path.throughput /= survival;
                }
            }
        }
    }
}

impl Walk {
    /// The next segment starts here.
    pub fn begin_segment(&mut self, position: Vec3) {
        if let Some(route) = &mut self.route {
            route.start = position;
        }
    }
}
