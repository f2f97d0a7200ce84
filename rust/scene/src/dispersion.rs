//! Dispersion of glass, which bends light by its wavelength.

use crate::Input;
use crate::sockets::with_sockets;

with_sockets! {
    /// Dispersion by Cauchy's formula (OpenPBR Surface 1.1, equations 55 and 56).
    #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
    pub struct Dispersion {
        /// Share of it, 0 to 1.
        pub scale: Input,
        /// Abbe number of full dispersion; 0 for none.
        pub abbe_number: Input,
        /// Scene-linear RGB of white light's wavelengths, for equal steps of [`Dispersion::RANGE_NM`]. Their mean is 1, and none is
        /// negative.
        pub colors: Vec<[f32; 3]>,
    }
}

impl Dispersion {
    /// Wavelengths that are seen, nm.
    pub const RANGE_NM: [f32; 2] = [380.0, 780.0];

    /// True if its colours are as they have to be, and there are some.
    pub fn is_valid(&self) -> bool {
        let valid = |color: &[f32; 3]| color.iter().all(|channel| channel.is_finite() && *channel >= 0.0);
        !self.colors.is_empty() && self.colors.iter().all(valid)
    }
}
