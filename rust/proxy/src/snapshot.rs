use crate::trainer::TrainState;
use crate::{ProxyError, Trainer};

/// A training as it was at a moment, in memory: what it goes on from where a device is lost.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Samples of the whole training.
    samples: u64,
    state: TrainState,
}

impl Trainer {
    /// The training as it is now. On a device, four vectors as long as the weights are read back.
    ///
    /// # Errors
    /// [`ProxyError::Gpu`] if the training was on a device that was lost.
    pub fn snapshot(&self) -> Result<Snapshot, ProxyError> {
        Ok(Snapshot { samples: self.config.samples, state: self.whole_state()?.into_owned() })
    }

    /// A training that goes on as the one did that the snapshot is of, on the CPU: this one must be new, of the same features,
    /// kind, configuration and seed.
    pub fn from_snapshot(mut self, snapshot: Snapshot) -> Self {
        self.set_samples(snapshot.samples);
        self.restore(snapshot.state);
        self
    }
}
