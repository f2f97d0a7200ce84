use crate::progress::{Listener, Progress};
use std::sync::Mutex;

/// Listener that keeps warnings.
#[derive(Default)]
pub struct Warnings(pub Mutex<Vec<String>>);

impl Listener for Warnings {
    fn progress(&self, _: &Progress) {}
    fn warning(&self, message: &str) {
        self.0.lock().unwrap().push(message.into());
    }
}
