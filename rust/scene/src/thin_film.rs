//! Thin transparent films upon surfaces, which shimmer.

use crate::Input;
use crate::sockets::with_sockets;

/// Colours of a film.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FilmModel {
    /// Those of Gaussians that fit the observer; films fade below 30 nm.
    Fitted,
    /// Those of the observer's table; films fade below 1 nm.
    Tabulated,
}

with_sockets! {
    /// A film between air and a surface.
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    pub struct ThinFilm {
        /// Thickness in nanometres.
        pub thickness: Input,
        /// Index of refraction.
        pub ior: Input,
        /// Colours.
        pub model: FilmModel,
        /// True if metals have it, too.
        pub on_metal: bool,
    }
}
