use crate::RelightError;

/// Why lights could not be solved. Each message names what to change.
#[derive(Debug, thiserror::Error)]
pub enum OptimiseError {
    /// Target, base and relighter are not of one size.
    #[error(
        "the {what} is {found:?} pixels, the relighter makes {expected:?}; bake and target need one resolution"
    )]
    Size {
        /// Which picture.
        what: &'static str,
        /// Its width and height.
        found: (usize, usize),
        /// The relighter's width and height.
        expected: (usize, usize),
    },
    /// A picture holds NaN or infinity, or is not RGB.
    #[error("the {0} must be an RGB picture of finite values")]
    Picture(&'static str),
    /// Bounds that hold nothing.
    #[error("bounds of {0} must be finite, the lower below the upper, and a radius above 0")]
    Bounds(&'static str),
    /// No lights, or a start of another number of lights than locks.
    #[error(
        "a start holds {found} lights, {expected} are to be solved; give at least one light and one start"
    )]
    Starts {
        /// Lights in the start.
        found: usize,
        /// Entries in the list of locks.
        expected: usize,
    },
    /// The settings cannot be used.
    #[error("{0}")]
    Settings(&'static str),
    /// The relighter failed.
    #[error("relighting failed: {0}")]
    Relight(#[from] RelightError),
    /// All starts ran into values that are not finite.
    #[error("no start led to a finite picture; lower the learning rate or check the proxy")]
    Diverged,
}
