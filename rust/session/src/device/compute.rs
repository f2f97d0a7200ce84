use std::str::FromStr;
use std::sync::Arc;

use relume_gpu::{Gpu, GpuChoice, GpuError};

use crate::error::SessionError;
use crate::progress::Monitor;

/// Device to compute on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Device {
    /// The best graphics card; the CPU where there is none, or where it fails.
    #[default]
    Auto,
    /// The CPU.
    Cpu,
    /// A certain GPU, or an error.
    Gpu(GpuChoice),
}

impl FromStr for Device {
    type Err = std::convert::Infallible;

    /// `auto`, `cpu`, `gpu` (the best, software drivers included), a part of a GPU's name, or the place where it is
    /// plugged in ([`GpuChoice::Named`]).
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(match text {
            "auto" => Self::Auto,
            "cpu" => Self::Cpu,
            "gpu" => Self::Gpu(GpuChoice::Best),
            name => Self::Gpu(GpuChoice::Named(name.to_owned())),
        })
    }
}

impl Device {
    /// Opens the device. `memory` is the budget in bytes for all that this process puts on a GPU; by default a share of
    /// what its driver reports. All users of one GPU share its device, so the budget set last counts.
    ///
    /// # Errors
    /// If a GPU was asked for and there is none, or it cannot be used.
    pub fn open(&self, memory: Option<u64>) -> Result<Compute, SessionError> {
        let choice = match self {
            Self::Cpu => return Ok(Compute::default()),
            Self::Auto => GpuChoice::BestHardware,
            Self::Gpu(choice) => choice.clone(),
        };
        let reopen = ReopenParams { choice, memory };
        let may_fall_back = *self == Self::Auto;
        match reopen.open() {
            Ok(gpu) => {
                Ok(Compute { gpu: Some(gpu), may_fall_back, reopen: Some(reopen), fallback_reason: None })
            }
            Err(error) if may_fall_back => Ok(Compute::without_gpu(&error)),
            Err(error) => Err(error.into()),
        }
    }
}

/// Devices that are open.
#[derive(Clone, Debug)]
struct ReopenParams {
    choice: GpuChoice,
    memory: Option<u64>,
}

impl ReopenParams {
    /// The one that is open, or a new one if that was lost.
    fn open(&self) -> Result<Arc<Gpu>, GpuError> {
        let gpu = Gpu::shared(&self.choice)?;
        gpu.set_memory_budget(self.memory);
        Ok(gpu)
    }
}

/// An open device.
#[derive(Clone, Debug, Default)]
pub struct Compute {
    /// The GPU; none if the CPU does everything.
    pub gpu: Option<Arc<Gpu>>,
    /// True if the CPU may take over when the GPU fails.
    pub may_fall_back: bool,
    /// Reason why the CPU does everything although there is a GPU.
    fallback_reason: Option<String>,
    /// None if it cannot be opened again.
    reopen: Option<ReopenParams>,
}

impl Compute {
    /// A device that somebody else has opened, and opens again if it is lost.
    pub fn with(gpu: Arc<Gpu>, may_fall_back: bool) -> Self {
        Self { gpu: Some(gpu), may_fall_back, ..Self::default() }
    }

    /// The CPU, since the best GPU could not be opened: that there is none is no news.
    fn without_gpu(error: &GpuError) -> Self {
        let fallback_reason = (*error != GpuError::NoAdapter).then(|| error.to_string());
        Self { fallback_reason, ..Self::default() }
    }

    /// Warns the user if the CPU does everything although there is a GPU.
    pub fn warn(&self, monitor: &Monitor) {
        self.fallback_reason.iter().for_each(|reason| monitor.warn(&format!("{reason}. The CPU does it")));
    }

    /// Runs work on the device. If the GPU was lost, it is opened anew and the work runs again, once. If it fails
    /// again, the CPU takes over where it may. `from` tells the user where the work goes on, as a part of a sentence.
    ///
    /// # Errors
    /// Errors of the last try.
    pub(crate) fn attempt<R>(
        &self,
        monitor: &Monitor,
        from: impl Fn() -> &'static str,
        mut work: impl FnMut(&Self) -> Result<R, SessionError>,
    ) -> Result<R, SessionError> {
        let mut result = work(self);
        if let Err(error) = &result
            && let Some(reason) = error.lost_gpu()
            && let Some(Ok(gpu)) = self.reopen.as_ref().map(ReopenParams::open)
        {
            monitor.warn(&format!("the GPU was lost ({reason}); it was opened again and goes on{}", from()));
            result = work(&Self { gpu: Some(gpu), ..self.clone() });
        }
        match result {
            Err(error) if self.may_fall_back && error.is_of_gpu() => {
                monitor.warn(&format!("{error}. The CPU goes on{}", from()));
                work(&Self::default())
            }
            result => result,
        }
    }
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::progress::Cancel;
    use crate::test_warnings::Warnings;

    #[test]
    fn words_and_names_are_devices() {
        assert_eq!("auto".parse(), Ok(Device::Auto));
        assert_eq!("cpu".parse(), Ok(Device::Cpu));
        assert_eq!("gpu".parse(), Ok(Device::Gpu(GpuChoice::Best)));
        assert_eq!("RTX 5090".parse(), Ok(Device::Gpu(GpuChoice::Named("RTX 5090".into()))));
    }

    #[test]
    fn the_cpu_is_no_gpu_and_a_missing_one_is_an_error() {
        assert!(Device::Cpu.open(None).unwrap().gpu.is_none());
        assert!(Device::Gpu(GpuChoice::Best).open(None).unwrap().gpu.is_some());
        let error = Device::Gpu(GpuChoice::Named("no such card".into())).open(None).unwrap_err();
        assert!(error.to_string().contains("no such card"), "{error}");
    }

    #[test]
    fn the_cpu_takes_over_in_silence_only_where_there_is_no_card() {
        let warned = |error: &GpuError| {
            let warnings = Arc::new(Warnings::default());
            let monitor = Monitor::new(warnings.clone(), Cancel::default());
            let compute = Compute::without_gpu(error);
            compute.warn(&monitor);
            assert!(compute.gpu.is_none());
            let warnings = warnings.0.lock().unwrap();
            warnings.clone()
        };
        assert!(warned(&GpuError::NoAdapter).is_empty());
        let lacks = "its driver has no push constants";
        let unsuitable = GpuError::Unsuitable { adapter: "A card".into(), missing: lacks.into() };
        for (error, reason) in [(GpuError::NoDriver, "no driver offers it"), (unsuitable, lacks)] {
            let warnings = warned(&error);
            assert!(warnings.len() == 1 && warnings[0].contains(reason), "{warnings:?}");
            assert!(warnings[0].ends_with(". The CPU does it"), "{warnings:?}");
        }
    }

    #[test]
    fn a_device_is_opened_again_once_and_the_cpu_comes_last() {
        let lost = Gpu::open(&GpuChoice::Best).unwrap();
        lost.lose();
        let reopen = Some(ReopenParams { choice: GpuChoice::Best, memory: None });
        let opened = Compute { reopen, ..Compute::with(Arc::clone(&lost), false) };
        let fails = |reason: &str| SessionError::from(GpuError::Lost(reason.into()));
        for may_fall_back in [false, true] {
            let compute = Compute { may_fall_back, ..opened.clone() };
            let mut tries = Vec::new();
            let outcome = compute.attempt(
                &Monitor::default(),
                || "",
                |compute| {
                    tries.push(compute.gpu.as_ref().map(|gpu| Arc::ptr_eq(gpu, &lost)));
                    compute.gpu.as_ref().map_or(Ok("done"), |_| Err(fails("again")))
                },
            );
            assert_eq!(tries, [Some(true), Some(false), None][..2 + usize::from(may_fall_back)]);
            assert_eq!(outcome.is_ok(), may_fall_back);
        }
        // Other failures are no reason to try again.
        let mut tries = 0;
        let refused = opened.attempt(
            &Monitor::default(),
            || "",
            |_| {
                tries += 1;
                Err::<(), _>(SessionError::from(GpuError::Refused("it".into())))
            },
        );
        assert!(refused.is_err() && tries == 1);
    }
}
