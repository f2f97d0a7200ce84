//! Input sockets of nodes, found by the types of their fields: a node that is declared in [`with_sockets`] cannot forget one.

use crate::{
    BlendMode, ColorMode, Curve, Dimensions, Distribution, Extension, FilmModel, GradientKind, HairComponent,
    HairModel, HairPigment, IesProfile, ImageProjection, Input, IntegerMathOp, Interpolation, MapRangeKind,
    MappingKind, MathOp, MetalFresnel, Metric, MixData, MultipleScattering, NodeId, NoiseKind, NormalSpace,
    RaycastOutput, SheenModel, SubsurfaceModel, SurfaceBase, TangentKind, TexCoord, Tile, ToonComponent,
    VectorMathOp, VoronoiFeature, VoronoiHash, WaveDirection, WaveKind, WaveProfile,
};

/// A node, or a field of one.
pub(crate) trait Sockets {
    /// Calls `visit` for every input socket in it.
    fn visit_sockets(&mut self, visit: &mut impl FnMut(&mut Input));
}

impl Sockets for Input {
    fn visit_sockets(&mut self, visit: &mut impl FnMut(&mut Input)) {
        visit(self);
    }
}

impl<T: Sockets> Sockets for Option<T> {
    fn visit_sockets(&mut self, visit: &mut impl FnMut(&mut Input)) {
        self.iter_mut().for_each(|field| field.visit_sockets(visit));
    }
}

/// Types of properties, which have no sockets.
macro_rules! properties {
    ($($property:ty),* $(,)?) => {
        $(impl Sockets for $property {
            fn visit_sockets(&mut self, _: &mut impl FnMut(&mut Input)) {}
        })*
    };
}

properties![
    FilmModel,
    bool,
    f32,
    usize,
    NodeId,
    String,
    IesProfile,
    ImageProjection,
    Vec<Tile>,
    Vec<[f32; 3]>
];
properties![
    BlendMode,
    SurfaceBase,
    ColorMode,
    Curve,
    Distribution,
    Extension,
    Interpolation,
    MapRangeKind,
    MappingKind
];
properties![HairComponent, HairModel, HairPigment, MetalFresnel, RaycastOutput, SheenModel, ToonComponent];
properties![
    IntegerMathOp,
    MathOp,
    MixData,
    MultipleScattering,
    NormalSpace,
    SubsurfaceModel,
    TangentKind,
    TexCoord,
    VectorMathOp
];
properties![Dimensions, GradientKind, Metric, NoiseKind, VoronoiFeature, VoronoiHash];
properties![WaveDirection, WaveKind, WaveProfile];

/// Declares a struct, or an enum of variants with named fields, a single one or none, together with its [`Sockets`].
macro_rules! with_sockets {
    (
        $(#[$attribute:meta])*
        pub struct $name:ident {
            $($(#[$of_field:meta])* pub $field:ident: $type:ty),* $(,)?
        }
    ) => {
        $(#[$attribute])*
        pub struct $name {
            $($(#[$of_field])* pub $field: $type),*
        }

        impl $crate::sockets::Sockets for $name {
            fn visit_sockets(&mut self, visit: &mut impl FnMut(&mut $crate::Input)) {
                $($crate::sockets::Sockets::visit_sockets(&mut self.$field, visit);)*
            }
        }
    };
    (
        $(#[$attribute:meta])*
        pub enum $name:ident {
            $(
                $(#[$of_variant:meta])*
                $variant:ident
                $({ $($(#[$of_field:meta])* $field:ident: $type:ty),* $(,)? })?
                $(($inner:ty))?
            ),* $(,)?
        }
    ) => {
        $(#[$attribute])*
        pub enum $name {
            $(
                $(#[$of_variant])*
                $variant $({ $($(#[$of_field])* $field: $type),* })? $(($inner))?
            ),*
        }

        impl $crate::sockets::Sockets for $name {
            fn visit_sockets(&mut self, visit: &mut impl FnMut(&mut $crate::Input)) {
                match self {
                    $(
                        Self::$variant $({ $($field),* })? $(($crate::sockets::first!(inner $inner)))? => {
                            $($($crate::sockets::Sockets::visit_sockets($field, visit);)*)?
                            $($crate::sockets::Sockets::visit_sockets(
                                $crate::sockets::first!(inner $inner), visit,
                            );)?
                        }
                    )*
                }
            }
        }
    };
}
pub(crate) use with_sockets;

/// The first of two things: repeats a name for each of what is not used otherwise.
macro_rules! first {
    ($first:ident $second:ty) => {
        $first
    };
}
pub(crate) use first;
