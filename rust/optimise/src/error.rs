use crate::RelightError;

/// Why lights could not be solved. Each message names what to change.
#[derive(Debug, thiserror::Error)]
pub enum OptimiseError {
    /// A picture is not of the relighter's size.
    #[error(
        "the {what} is {} x {} pixels, the bake {} x {}; make both of one size",
        found.0, found.1, expected.0, expected.1
    )]
    Size {
        /// Picture that does not fit.
        what: &'static str,
        /// Width and height of the picture.
        found: (usize, usize),
        /// The relighter's width and height.
        expected: (usize, usize),
    },
    /// A picture holds NaN or infinity, or is not RGB.
    #[error("the {0} must be an RGB picture of finite values")]
    Picture(&'static str),
    /// A target without light.
    #[error("the target is black everywhere; no light can be found from it, choose another picture")]
    BlackTarget,
    /// A picture without light, and no target beside what is asked for.
    #[error(
        "the picture is black, so that a stroke has nothing to go by; give a light some strength, or choose a target picture"
    )]
    BlackBefore,
    /// A colour that has no hue.
    #[error("goal {0} asks for black; ask for darker instead, or choose a colour")]
    BlackColor(usize),
    /// A goal without a pixel.
    #[error("goal {0} concerns no pixel of the picture; paint inside the camera frame")]
    EmptyGoal(usize),
    /// Lack of goals: nothing is asked for.
    #[error("nothing is asked for; paint a stroke or choose a target picture")]
    NoGoal,
    /// All is locked.
    #[error("nothing may change; unlock a value of a light, or allow new lights")]
    NothingFree,
    /// Bounds that hold nothing.
    #[error("light '{light}': bounds of {what} must be finite and above 0, the lower below the upper")]
    Bounds {
        /// The light.
        light: String,
        /// Bounds that are wrong.
        what: &'static str,
    },
    /// A light whose shape stays comes without its picture, or one whose shape moves with one.
    #[error("light '{0}': a picture is needed if, and only if, its shape stays")]
    Still(String),
    /// A list is not as long as that of the lights.
    #[error("{found} lights are given where {expected} are to be solved")]
    Lights {
        /// Number found.
        found: usize,
        /// Expected number.
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
