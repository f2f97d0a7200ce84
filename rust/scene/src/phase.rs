use crate::Input;
use crate::sockets::with_sockets;

with_sockets! {
    /// Angular distribution of what a medium scatters (Blender's `phase`). `anisotropy` is the mean cosine of Henyey and Greenstein.
    #[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    #[serde(tag = "type", rename_all = "snake_case")]
    #[expect(missing_docs, reason = "the sockets of Blender's volume nodes")]
    pub enum PhaseFunction {
        /// Henyey and Greenstein's.
        HenyeyGreenstein {
            anisotropy: Input,
        },
        /// Fournier and Forand's, for water: refractive index of the particles, and the share that is scattered backwards.
        FournierForand {
            ior: Input,
            backscatter: Input,
        },
        /// Draine's, between Henyey-Greenstein (`alpha` 0) and Rayleigh.
        Draine {
            anisotropy: Input,
            alpha: Input,
        },
        /// Rayleigh's, for particles much smaller than a wavelength.
        Rayleigh,
        /// Jendersie and d'Eon's fit of Mie scattering by droplets of water; `diameter` in micrometres.
        Mie {
            diameter: Input,
        },
    }
}
