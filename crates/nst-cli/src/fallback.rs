//! A network that runs on the GPU, and on the CPU once the GPU has failed.

use std::{
    mem,
    sync::{Mutex, PoisonError},
    thread::{self, JoinHandle},
};

use nst_core::{Error, Estimates, Fitted, MlpCpu, Requirements, SequenceBatch, Strips, Transform};

use crate::{
    adapter::{Adapter, caught, message_of},
    report::complain,
};

/// Evaluates on a GPU, if there is one, until it fails; then on the CPU, with one warning
/// on stderr. The CPU computes the whole strip again on which the GPU failed.
pub(crate) struct Fallback<G> {
    gpu: Mutex<Stage<G>>,
    cpu: MlpCpu,
    adapter: Adapter,
}

enum Stage<G> {
    /// Drivers take long to open; meanwhile the rest of the job goes on.
    Opening(JoinHandle<Result<(String, G), Error>>),
    Open(G),
    Failed,
}

impl<G: Fitted + 'static> Fallback<G> {
    /// Calls `open`, which returns a GPU and its name, on a new thread. From then on
    /// `adapter` has the name of the GPU in use.
    pub(crate) fn new(
        open: impl FnOnce() -> Result<(String, G), Error> + Send + 'static,
        cpu: MlpCpu,
        adapter: Adapter,
    ) -> Self {
        let opening = adapter.opens();
        let open = move || {
            let _until_the_end = opening;
            open()
        };
        Self { gpu: Mutex::new(Stage::Opening(thread::spawn(open))), cpu, adapter }
    }

    /// Waits for a GPU that is being opened.
    fn opened(stage: Stage<G>, adapter: &Adapter) -> Stage<G> {
        let Stage::Opening(thread) = stage else { return stage };
        let opened = thread.join().unwrap_or_else(|panic| Err(Error::Gpu(message_of(&*panic))));
        match opened {
            Ok((name, gpu)) => {
                adapter.set(Some(name));
                return Stage::Open(gpu);
            }
            // A machine without a GPU needs no warning.
            Err(Error::NoAdapter(_)) => {}
            Err(error) => warn(&error),
        }
        Stage::Failed
    }
}

impl<G: Fitted + 'static> Transform for Fallback<G> {
    fn requires(&self) -> Requirements {
        self.cpu.requires()
    }

    fn fit<'a>(&'a self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        Ok(Box::new(self))
    }
}

impl<G: Fitted + 'static> Fitted for Fallback<G> {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let mut stage = self.gpu.lock().unwrap_or_else(PoisonError::into_inner);
        *stage = Self::opened(mem::replace(&mut *stage, Stage::Failed), &self.adapter);
        if let Stage::Open(gpu) = &*stage {
            match caught(|| gpu.apply(strip, out)) {
                Ok(()) => return Ok(()),
                Err(error) => warn(&error),
            }
            *stage = Stage::Failed;
            self.adapter.set(None);
        }
        self.cpu.apply(strip, out)
    }
}

impl<G> Drop for Fallback<G> {
    /// Waits for a GPU that is being opened: a driver that is still loading when the
    /// process ends may crash it.
    fn drop(&mut self) {
        let stage = self.gpu.get_mut().unwrap_or_else(PoisonError::into_inner);
        if let Stage::Opening(thread) = mem::replace(stage, Stage::Failed) {
            // The result is not needed any more.
            let _ = thread.join();
        }
    }
}

/// Says that the CPU takes over.
fn warn(error: &Error) {
    complain(&format!("warning: {error}; going on with the CPU"));
}

#[cfg(test)]
mod tests {
    use std::{
        sync::{
            Arc,
            atomic::{AtomicU32, Ordering},
        },
        time::Duration,
    };

    use nst_core::Network;

    use super::*;

    /// Fails from the second batch on, and leaves rubbish behind.
    struct Breaks {
        cpu: MlpCpu,
        calls: Arc<AtomicU32>,
        panics: bool,
    }

    impl Fitted for Breaks {
        fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
            if self.calls.fetch_add(1, Ordering::Relaxed) == 0 {
                return self.cpu.apply(batch, out);
            }
            *out = Estimates::default();
            assert!(!self.panics, "the driver panics");
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
        cpu.transform(&batch, &mut expected)?;

        let adapter = Adapter::default();
        for panics in [false, true] {
            let calls = Arc::new(AtomicU32::new(0));
            let breaks = Breaks { cpu: cpu.clone(), calls: Arc::clone(&calls), panics };
            let open = || Ok(("a GPU".to_owned(), breaks));
            let fallback = Fallback::new(open, cpu.clone(), adapter.clone());
            for (batch_number, name) in [(1, Some("a GPU")), (2, None), (3, None)] {
                let mut estimates = Estimates::default();
                fallback.apply(&batch, &mut estimates)?;
                assert_eq!(estimates, expected, "batch {batch_number}");
                assert_eq!(adapter.name().as_deref(), name, "batch {batch_number}");
            }
            assert_eq!(calls.load(Ordering::Relaxed), 2);
        }

        let opened = Arc::new(AtomicU32::new(0));
        let slow = || {
            let opened = Arc::clone(&opened);
            move || {
                thread::sleep(Duration::from_millis(50));
                opened.store(1, Ordering::Relaxed);
                Err::<(_, MlpCpu), _>(Error::NoAdapter("no driver".into()))
            }
        };
        let adapter = Adapter::default();
        assert_eq!(adapter.opening(), None);
        let fallback = Fallback::new(slow(), cpu.clone(), adapter.clone());
        assert!(adapter.opening() >= Some(Duration::from_millis(50)), "{:?}", adapter.opening());
        drop(fallback);
        opened.store(0, Ordering::Relaxed);
        drop(Fallback::new(slow(), cpu.clone(), adapter.clone()));
        assert_eq!(opened.load(Ordering::Relaxed), 1, "dropped while a driver was loading");

        type Opened = Result<(String, MlpCpu), Error>;
        let none: fn() -> Opened = || Err(Error::NoAdapter("no driver".into()));
        let panic: fn() -> Opened = || panic!("the driver panics while it loads");
        for open in [none, panic] {
            let fallback = Fallback::new(open, cpu.clone(), adapter.clone());
            let mut estimates = Estimates::default();
            assert!(adapter.opening().is_some(), "a panic ends the opening too");
            fallback.apply(&batch, &mut estimates)?;
            assert_eq!((&estimates, adapter.name()), (&expected, None));
        }
        Ok(())
    }
}
