use crate::Input;
use crate::sockets::with_sockets;

/// Scattering model of Principled Hair.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HairModel {
    /// Chiang et al. 2016.
    #[default]
    Chiang,
    /// Huang et al. 2022.
    Huang,
}

/// Settings that the absorption of Principled Hair follows from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HairPigment {
    /// The coefficient itself.
    Absorption,
    /// Colour that the hair has.
    Color,
    /// Amount of melanin, and a dye.
    Melanin,
}

/// Lobe of a Hair BSDF.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HairComponent {
    /// Back to where the ray came from.
    Reflection,
    /// Beyond the fibre.
    Transmission,
}

with_sockets! {
    /// Blender's Principled Hair, with its socket names and units. Settings of the model or pigment that is not chosen do not
    /// count.
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[expect(missing_docs, reason = "the sockets of Blender's node of the same name")]
    pub struct PrincipledHair {
        pub model: HairModel,
        pub pigment: HairPigment,
        pub color: Input,
        pub melanin: Input,
        pub melanin_redness: Input,
        pub tint: Input,
        pub absorption_coefficient: Input,
        /// Huang's.
        pub aspect_ratio: Input,
        pub roughness: Input,
        /// Chiang's.
        pub radial_roughness: Input,
        /// Chiang's.
        pub coat: Input,
        pub ior: Input,
        pub offset: Input,
        pub random_color: Input,
        pub random_roughness: Input,
        /// None for the number of the strand.
        pub random: Option<Input>,
        /// Huang's.
        pub reflection: Input,
        /// Huang's.
        pub transmission: Input,
        /// Huang's.
        pub secondary_reflection: Input,
    }
}
