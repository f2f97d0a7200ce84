use std::sync::{Arc, Mutex, PoisonError};

use relume_gpu::Gpu;

use crate::device::compute::Compute;
use crate::error::SessionError;
use crate::progress::Monitor;

/// Value that is made on the GPU when it is first needed or was lost. It is given up if the GPU fails and the CPU may
/// take over.
pub(crate) struct OnGpu<T>(Mutex<Slot<T>>);

enum Slot<T> {
    NotStarted,
    Ready(Arc<T>),
    GivenUp,
}

impl<T> Default for OnGpu<T> {
    fn default() -> Self {
        Self(Mutex::new(Slot::NotStarted))
    }
}

impl<T> OnGpu<T> {
    /// Runs work there; none if the CPU has to do it.
    ///
    /// # Errors
    /// If the GPU fails that the user asked for.
    pub fn attempt<R, E: Into<SessionError>>(
        &self,
        compute: &Compute,
        monitor: &Monitor,
        make: impl Fn(Arc<Gpu>) -> Result<T, E>,
        work: impl Fn(&T) -> Result<R, E>,
    ) -> Result<Option<R>, SessionError> {
        if compute.gpu.is_none() {
            return Ok(None);
        }
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        compute.attempt(
            monitor,
            || "",
            |compute| {
                let Some(gpu) = &compute.gpu else {
                    *state = Slot::GivenUp;
                    return Ok(None);
                };
                let result = state.ready(|| make(gpu.clone())).and_then(|ready| ready.map(&work).transpose());
                result.map_err(E::into).inspect_err(|error| {
                    if error.lost_gpu().is_some() {
                        *state = Slot::NotStarted;
                    }
                })
            },
        )
    }

    /// Value that is there, for work that must not block that of others.
    pub fn get(&self) -> Option<Arc<T>> {
        match &*self.0.lock().unwrap_or_else(PoisonError::into_inner) {
            Slot::Ready(ready) => Some(Arc::clone(ready)),
            _ => None,
        }
    }
}

impl<T> Slot<T> {
    /// Value, made now if it is needed for the first time; none once it was given up.
    fn ready<E>(&mut self, make: impl FnOnce() -> Result<T, E>) -> Result<Option<&T>, E> {
        if let Self::NotStarted = self {
            *self = Self::Ready(Arc::new(make()?));
        }
        Ok(match self {
            Self::Ready(ready) => Some(ready),
            _ => None,
        })
    }
}
