//! One file per command.

mod trace;

use crate::args::Global;
use crate::console::Console;
use relume_session::Monitor;

pub use trace::trace;

/// What every command is given.
pub struct Context<'a> {
    pub console: &'a Console,
    pub monitor: &'a Monitor,
    pub global: &'a Global,
}
