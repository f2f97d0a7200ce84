//! Long work on a thread of its own. The thread never calls Python; Python polls.

use crate::error::{NativeError, RelumeError, native_error};
use pyo3::prelude::*;
use relume_session::{Cancel, Listener, Monitor, Progress};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

/// Events since the last poll.
#[derive(Default)]
struct Reports {
    progress: Option<Progress>,
    warnings: Vec<String>,
}

#[derive(Default)]
struct Inbox(Mutex<Reports>);

impl Inbox {
    fn reports(&self) -> MutexGuard<'_, Reports> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Listener for Inbox {
    fn progress(&self, progress: &Progress) {
        self.reports().progress = Some(progress.clone());
    }

    fn warning(&self, message: &str) {
        self.reports().warnings.push(message.into());
    }
}

/// Receives interim results, in JSON.
pub type InterimListener = dyn Fn(String) + Sync;

type JobResult = Result<serde_json::Value, NativeError>;

/// Running work.
#[pyclass(name = "Job", module = "relume", frozen)]
pub struct PyJob {
    inbox: Arc<Inbox>,
    cancel: Cancel,
    /// Interim result in JSON, since it was last asked for.
    preview: Arc<Mutex<Option<String>>>,
    thread: Mutex<Option<JoinHandle<JobResult>>>,
}

impl PyJob {
    /// Starts `work` on a new thread.
    pub fn start<E: Into<NativeError>>(
        work: impl FnOnce(&Monitor) -> Result<serde_json::Value, E> + Send + 'static,
    ) -> PyResult<Self> {
        Self::start_with_preview(move |monitor, _| work(monitor))
    }

    /// [`PyJob::start`] for `work` that also shows interim results.
    pub fn start_with_preview<E: Into<NativeError>>(
        work: impl FnOnce(&Monitor, &InterimListener) -> Result<serde_json::Value, E> + Send + 'static,
    ) -> PyResult<Self> {
        let preview = Arc::new(Mutex::new(None));
        let inbox_of_preview = preview.clone();
        let show = move |text: String| {
            *inbox_of_preview.lock().unwrap_or_else(PoisonError::into_inner) = Some(text);
        };
        let (inbox, cancel) = (Arc::new(Inbox::default()), Cancel::default());
        let monitor = Monitor::new(inbox.clone(), cancel.clone());
        let thread = std::thread::Builder::new()
            .name("relume-job".into())
            .spawn(move || work(&monitor, &show).map_err(Into::into))?;
        Ok(Self { inbox, cancel, preview, thread: Mutex::new(Some(thread)) })
    }
}

#[pymethods]
impl PyJob {
    #[getter]
    fn done(&self) -> bool {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner);
        thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    fn cancel(&self) {
        self.cancel.request();
    }

    fn progress(&self) -> Option<String> {
        let progress = self.inbox.reports().progress.take()?;
        serde_json::to_string(&progress).ok()
    }

    fn preview(&self) -> Option<String> {
        self.preview.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    fn warnings(&self) -> Vec<String> {
        std::mem::take(&mut self.inbox.reports().warnings)
    }

    fn result(&self, py: Python<'_>) -> PyResult<String> {
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        let thread = thread.ok_or_else(|| RelumeError::new_err("the result was taken already"))?;
        let outcome = py.detach(|| thread.join());
        let value = outcome.map_err(|payload| native_error(payload.as_ref()))??;
        Ok(value.to_string())
    }
}

/// Starts a command of the command line; its `--json` result is the job's.
#[pyfunction]
pub fn start_command(args: Vec<String>) -> PyResult<PyJob> {
    PyJob::start(move |monitor| relume_cli::run_captured(args.into_iter().map(Into::into), monitor))
}

/// Who bakes into a folder, if another process does, and what to do.
#[pyfunction]
pub fn folder_in_use(folder: PathBuf) -> Option<String> {
    relume_session::folder_in_use(&folder)
}

/// Runs a command line, prints as it goes and returns the exit code.
#[pyfunction]
pub fn run_command_line(py: Python<'_>, args: Vec<String>) -> PyResult<u8> {
    let args = std::iter::once("relume".to_string()).chain(args).map(Into::into).collect::<Vec<_>>();
    crate::error::enter_native(py, || Ok::<_, NativeError>(relume_cli::run(args)))
}
