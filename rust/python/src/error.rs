//! The one map from Rust errors to Python exceptions, and the one way into long-running Rust code.
//!
//! A new library error needs one line in [`native_errors`]: damaged input becomes `ValueError`, anything that the
//! user's machine refused becomes `OSError`, the rest `RelumeError`.

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

pyo3::create_exception!(_native, RelumeError, PyRuntimeError, "Relume could not do what was asked.");

/// Any error of the crates below, on its way to Python.
pub struct NativeError(PyErr);

impl From<NativeError> for PyErr {
    fn from(error: NativeError) -> Self {
        error.0
    }
}

macro_rules! native_errors {
    ($($error:ty => $exception:ty),* $(,)?) => {
        $(impl From<$error> for NativeError {
            fn from(error: $error) -> Self {
                Self(<$exception>::new_err(error.to_string()))
            }
        })*
    };
}

native_errors! {
    relume_scene::BuildError => PyValueError,
    relume_scene::CameraError => PyValueError,
    relume_scene::LightError => PyValueError,
    relume_scene::PolygonError => PyValueError,
    relume_session::SessionError => RelumeError,
    serde_json::Error => PyValueError,
}

impl From<anyhow::Error> for NativeError {
    fn from(error: anyhow::Error) -> Self {
        Self(RelumeError::new_err(format!("{error:#}")))
    }
}

/// A `ValueError` for arguments that only the binding sees.
pub fn invalid(message: impl Into<String>) -> NativeError {
    NativeError(PyValueError::new_err(message.into()))
}

/// Runs `work` without the GIL. Errors go through the map above; a panic becomes a [`RelumeError`].
pub fn enter_native<T, E>(py: Python<'_>, work: impl FnOnce() -> Result<T, E> + Send) -> PyResult<T>
where
    T: Send,
    E: Into<NativeError> + Send,
{
    // A panic ends the call: Python never sees what it left half done.
    let outcome = py.detach(|| catch_unwind(AssertUnwindSafe(|| work().map_err(Into::into))));
    match outcome {
        Ok(result) => result.map_err(|error: NativeError| error.0),
        Err(payload) => Err(native_error(payload.as_ref())),
    }
}

/// The exception for a panic.
pub fn native_error(payload: &(dyn Any + Send)) -> PyErr {
    let text = payload.downcast_ref::<&str>().copied();
    let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str));
    RelumeError::new_err(format!("internal error, please report it: {}", text.unwrap_or("no message")))
}
