//! Which GPU is in use, and panics of its driver.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use nst_core::Error;

/// The name of the GPU that a transformation runs on; `None` while it is on the CPU.
#[derive(Clone, Default)]
pub(crate) struct Adapter(Arc<Mutex<Option<String>>>);

impl Adapter {
    pub(crate) fn name(&self) -> Option<String> {
        self.lock().clone()
    }

    pub(crate) fn set(&self, name: Option<String>) {
        *self.lock() = name;
    }

    fn lock(&self) -> MutexGuard<'_, Option<String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
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
