//! A network on the GPU for as long as that works, then on the CPU.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use nst_core::{Error, Estimates, MlpCpu, SequenceBatch, Transform};

/// `gpu` until it fails, then `cpu`, with one warning on stderr. A batch on which the
/// GPU fails is evaluated anew, so that no result depends on when that was.
pub(crate) struct Fallback<G> {
    gpu: G,
    cpu: MlpCpu,
    /// Set when the CPU takes over.
    failed: Arc<AtomicBool>,
}

impl<G> Fallback<G> {
    /// Sets `failed` when the CPU takes over.
    pub(crate) fn new(gpu: G, cpu: MlpCpu, failed: Arc<AtomicBool>) -> Self {
        Self { gpu, cpu, failed }
    }
}

impl<G: Transform> Transform for Fallback<G> {
    fn window(&self) -> usize {
        self.cpu.window()
    }

    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        if !self.failed.load(Ordering::Relaxed) {
            match self.gpu.apply(batch, out) {
                Ok(()) => return Ok(()),
                Err(error) => warn(&error),
            }
            self.failed.store(true, Ordering::Relaxed);
        }
        self.cpu.apply(batch, out)
    }
}

/// Says that the CPU takes over.
pub(crate) fn warn(error: &Error) {
    eprintln!("warning: {error}; going on with the CPU");
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use nst_core::Network;

    use super::*;

    /// Fails from the second batch on, and leaves rubbish behind.
    struct Breaks {
        cpu: MlpCpu,
        calls: Cell<u32>,
    }

    impl Transform for Breaks {
        fn window(&self) -> usize {
            self.cpu.window()
        }

        fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
            self.calls.set(self.calls.get() + 1);
            if self.calls.get() == 1 {
                return self.cpu.apply(batch, out);
            }
            *out = Estimates::default();
            Err(Error::Gpu("the device was lost".into()))
        }
    }

    #[test]
    fn a_gpu_that_fails_is_tried_no_more() -> Result<(), Error> {
        let network = Network::builtin("families").expect("it is in the crate")?;
        let cpu = MlpCpu::new(network);
        let samples: Vec<f32> = (0..9 * 5).map(|i| ((i * i) % 11) as f32).collect();
        let batch = SequenceBatch::from_samples(5, &samples)?;
        let mut expected = Estimates::default();
        cpu.apply(&batch, &mut expected)?;

        let breaks = Breaks { cpu: cpu.clone(), calls: Cell::new(0) };
        let has_failed = Arc::new(AtomicBool::new(false));
        let fallback = Fallback::new(breaks, cpu, Arc::clone(&has_failed));
        for (batch_number, failed) in [(1, false), (2, true), (3, true)] {
            let mut estimates = Estimates::default();
            fallback.apply(&batch, &mut estimates)?;
            assert_eq!(estimates, expected, "batch {batch_number}");
            assert_eq!(has_failed.load(Ordering::Relaxed), failed, "batch {batch_number}");
        }
        assert_eq!(fallback.gpu.calls.get(), 2);
        Ok(())
    }
}
