//! A network on the GPU for as long as that works, then on the CPU.

use std::{
    cell::RefCell,
    mem,
    panic::resume_unwind,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    thread::{self, JoinHandle},
};

use nst_core::{Error, Estimates, MlpCpu, SequenceBatch, Transform};

/// The name of the GPU that a transformation runs on, while it does.
#[derive(Clone, Default)]
pub(crate) struct Adapter(Arc<Mutex<Option<String>>>);

impl Adapter {
    pub(crate) fn new(name: String) -> Self {
        Self(Arc::new(Mutex::new(Some(name))))
    }

    pub(crate) fn name(&self) -> Option<String> {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, Option<String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A GPU, if there is one, until it fails, then the CPU, with one warning on stderr. A
/// batch on which the GPU fails is evaluated anew, so that no result depends on when
/// that was.
pub(crate) struct Fallback<G> {
    gpu: RefCell<Stage<G>>,
    cpu: MlpCpu,
    adapter: Adapter,
}

enum Stage<G> {
    /// Drivers take their time, in which the job's other parts go on.
    Opening(JoinHandle<Result<(String, G), Error>>),
    Open(G),
    Failed,
}

impl<G: Transform + Send + 'static> Fallback<G> {
    /// Opens the GPU on a thread of its own; `open` gives its name, too. `adapter` is
    /// kept up to date.
    pub(crate) fn new(
        open: impl FnOnce() -> Result<(String, G), Error> + Send + 'static,
        cpu: MlpCpu,
        adapter: Adapter,
    ) -> Self {
        Self { gpu: RefCell::new(Stage::Opening(thread::spawn(open))), cpu, adapter }
    }

    /// Waits for a GPU that is being opened.
    fn opened(stage: Stage<G>, adapter: &Adapter) -> Stage<G> {
        let Stage::Opening(thread) = stage else { return stage };
        match thread.join().unwrap_or_else(|panic| resume_unwind(panic)) {
            Ok((name, gpu)) => {
                *adapter.lock() = Some(name);
                return Stage::Open(gpu);
            }
            // A machine without a GPU is nothing to warn of.
            Err(Error::NoAdapter(_)) => {}
            Err(error) => warn(&error),
        }
        Stage::Failed
    }
}

impl<G: Transform + Send + 'static> Transform for Fallback<G> {
    fn window(&self) -> usize {
        self.cpu.window()
    }

    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let mut stage = self.gpu.borrow_mut();
        *stage = Self::opened(mem::replace(&mut *stage, Stage::Failed), &self.adapter);
        if let Stage::Open(gpu) = &*stage {
            match gpu.apply(batch, out) {
                Ok(()) => return Ok(()),
                Err(error) => warn(&error),
            }
            *stage = Stage::Failed;
            *self.adapter.lock() = None;
        }
        self.cpu.apply(batch, out)
    }
}

impl<G> Drop for Fallback<G> {
    /// Waits for a GPU that is being opened: drivers that are still loading when the
    /// process ends have crashed it.
    fn drop(&mut self) {
        if let Stage::Opening(thread) = mem::replace(self.gpu.get_mut(), Stage::Failed) {
            // Whatever came of it is of no use now.
            let _ = thread.join();
        }
    }
}

/// Says that the CPU takes over.
fn warn(error: &Error) {
    eprintln!("warning: {error}; going on with the CPU");
}

#[cfg(test)]
mod tests {
    use std::{
        sync::atomic::{AtomicU32, Ordering},
        time::Duration,
    };

    use nst_core::Network;

    use super::*;

    /// Fails from the second batch on, and leaves rubbish behind.
    struct Breaks {
        cpu: MlpCpu,
        calls: Arc<AtomicU32>,
    }

    impl Transform for Breaks {
        fn window(&self) -> usize {
            self.cpu.window()
        }

        fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
            if self.calls.fetch_add(1, Ordering::Relaxed) == 0 {
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

        let calls = Arc::new(AtomicU32::new(0));
        let breaks = Breaks { cpu: cpu.clone(), calls: Arc::clone(&calls) };
        let adapter = Adapter::default();
        let open = || Ok(("a GPU".to_owned(), breaks));
        let fallback = Fallback::new(open, cpu.clone(), adapter.clone());
        for (batch_number, name) in [(1, Some("a GPU")), (2, None), (3, None)] {
            let mut estimates = Estimates::default();
            fallback.apply(&batch, &mut estimates)?;
            assert_eq!(estimates, expected, "batch {batch_number}");
            assert_eq!(adapter.name().as_deref(), name, "batch {batch_number}");
        }
        assert_eq!(calls.load(Ordering::Relaxed), 2);

        let opened = Arc::new(AtomicU32::new(0));
        let slow = {
            let opened = Arc::clone(&opened);
            move || {
                thread::sleep(Duration::from_millis(50));
                opened.store(1, Ordering::Relaxed);
                Err::<(_, MlpCpu), _>(Error::NoAdapter("no driver".into()))
            }
        };
        drop(Fallback::new(slow, cpu.clone(), adapter.clone()));
        assert_eq!(opened.load(Ordering::Relaxed), 1, "dropped while a driver was loading");

        let none = || Err::<(_, MlpCpu), _>(Error::NoAdapter("no driver".into()));
        let fallback = Fallback::new(none, cpu, adapter.clone());
        let mut estimates = Estimates::default();
        fallback.apply(&batch, &mut estimates)?;
        assert_eq!((estimates, adapter.name()), (expected, None));
        Ok(())
    }
}
