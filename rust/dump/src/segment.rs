use glam::Vec3;

/// The lobe that made a segment, as Cycles labels rays. Decides per-light factors and camera visibility.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Lobe {
    /// A camera ray, also where it continues through transparent surfaces.
    Camera = 0,
    /// Diffuse reflection.
    Diffuse = 1,
    /// Glossy reflection, singular included.
    Glossy = 2,
    /// Transmission, diffuse or not; not transparency, which keeps the lobe of the ray that meets it.
    Transmission = 3,
    /// Volume scattering.
    Volume = 4,
}

impl Lobe {
    /// Every lobe; the index is its code.
    pub const ALL: [Self; 5] = [Self::Camera, Self::Diffuse, Self::Glossy, Self::Transmission, Self::Volume];
}

/// End of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum End {
    /// Position of the next path vertex, world space.
    Vertex(Vec3),
    /// Nowhere: the ray leaves the scene in this unit direction.
    Escape(Vec3),
}

/// One segment of a path: from the end of the previous one (or the camera) to `end`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// End of the segment.
    pub end: End,
    /// `T_k`: RGB weight of what is emitted towards the path along this segment, Russian roulette included.
    pub throughput: Vec3,
    /// Scattering event that made the segment.
    pub lobe: Lobe,
    /// Receiver number of the object that made it (the `receiver` of its instance), also where it goes on through
    /// transparent surfaces; below [`crate::RECEIVER_LIMIT`], 0 for camera rays; with its class, see
    /// [`crate::SegmentClasses`].
    pub receiver: u16,
    /// True if it continues the ray of the previous segment straight on, behind a transparent surface or a null collision.
    pub continues: bool,
}
