//! Which GPU is in use, and panics of its driver.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError},
    time::{Duration, Instant},
};

use nst_core::Error;

/// The GPU that a transformation runs on.
#[derive(Clone, Default)]
pub(crate) struct Adapter {
    /// `None` while it is on the CPU.
    name: Arc<Mutex<Option<String>>>,
    /// Empty where no GPU is opened, and then empty until it is.
    opening: Arc<OnceLock<OnceLock<Duration>>>,
}

/// Measures how long a GPU is being opened: until this is dropped.
pub(crate) struct Opening {
    adapter: Adapter,
    begin: Instant,
}

impl Drop for Opening {
    fn drop(&mut self) {
        let _ = self.adapter.opening.get_or_init(OnceLock::new).set(self.begin.elapsed());
    }
}

impl Adapter {
    /// From now on, a GPU is being opened.
    pub(crate) fn opens(&self) -> Opening {
        self.opening.get_or_init(OnceLock::new);
        Opening { adapter: self.clone(), begin: Instant::now() }
    }

    /// What `open` makes on a GPU, which it names.
    #[cfg(feature = "gpu")]
    pub(crate) fn open<T>(
        &self,
        open: impl FnOnce() -> Result<(String, T), Error>,
    ) -> Result<T, crate::error::Error> {
        let opening = self.opens();
        let opened = caught(open);
        drop(opening);
        let (name, opened) = opened.map_err(crate::error::Error::Gpu)?;
        self.set(Some(name));
        Ok(opened)
    }

    /// How long it took to open a GPU, or to find none; waits until that is done. `None` if
    /// nobody tries.
    pub(crate) fn opening(&self) -> Option<Duration> {
        self.opening.get().map(|time| *time.wait())
    }

    pub(crate) fn name(&self) -> Option<String> {
        self.lock().clone()
    }

    pub(crate) fn set(&self, name: Option<String>) {
        *self.lock() = name;
    }

    fn lock(&self) -> MutexGuard<'_, Option<String>> {
        self.name.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Does `work` on a GPU; a panic of the driver becomes an error.
pub(crate) fn caught<T>(work: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    // Nothing reads what `work` has left half done.
    catch_unwind(AssertUnwindSafe(work))
        .unwrap_or_else(|panic| Err(Error::Gpu(message_of(&*panic))))
}

/// What a panic said.
pub(crate) fn message_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("a panic").to_owned()
}
