use glam::Vec3;

/// The lobe that made a segment, as Cycles parts closures where it samples lights, but for glass, each side of which has its own, and
/// for the two kinds each of gloss and transmission. Decides per-light factors and camera visibility.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Lobe {
    /// A camera ray, also where it continues through transparent surfaces.
    Camera = 0,
    /// Diffuse scattering, to either side of a surface.
    Diffuse = 1,
    /// Glossy reflection, singular included, but for [`Self::RoughGlossy`].
    Glossy = 2,
    /// Refraction but for [`Self::RoughTransmission`], and transmission of the Hair BSDF; not transparency, which keeps the lobe of the
    /// ray that meets it.
    Transmission = 3,
    /// Volume scattering.
    Volume = 4,
    /// Glossy reflection so wide that lights are connected to its vertices, and Principled Hair.
    RoughGlossy = 5,
    /// Refraction so wide that lights are connected to its vertices, and what comes through rough thin sheets.
    RoughTransmission = 6,
}

impl Lobe {
    /// Every lobe; the index is its code.
    pub const ALL: [Self; 7] = [
        Self::Camera,
        Self::Diffuse,
        Self::Glossy,
        Self::Transmission,
        Self::Volume,
        Self::RoughGlossy,
        Self::RoughTransmission,
    ];

    /// Lobes whose light may be summed by points on lights in place of crossings.
    pub const CONNECTED: [Self; 4] =
        [Self::Diffuse, Self::RoughGlossy, Self::Volume, Self::RoughTransmission];

    /// Its number among [`Self::CONNECTED`].
    pub fn connected_number(self) -> Option<usize> {
        Self::CONNECTED.into_iter().position(|lobe| lobe == self)
    }

    /// The lobe as Cycles tells rays apart.
    pub fn ray_kind(self) -> Self {
        match self {
            Self::RoughGlossy => Self::Glossy,
            Self::RoughTransmission => Self::Transmission,
            other => other,
        }
    }
}

/// A value for each of [`Lobe::CONNECTED`].
pub type ByConnectedLobe<T> = [T; Lobe::CONNECTED.len()];

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
