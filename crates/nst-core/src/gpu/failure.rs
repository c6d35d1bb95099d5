//! What goes wrong on a device: an error belongs to the call during which it came up; only
//! the loss of the device is for good.

use std::sync::{Arc, Mutex, PoisonError};

use super::Gpu;
use crate::Error;

/// Why a device is of no more use, once it is not: it was lost, or it reported an error that
/// no call was there to catch.
#[derive(Clone, Debug, Default)]
pub(super) struct Failure(Arc<Mutex<Option<String>>>);

impl Failure {
    /// Has the device report here.
    pub(super) fn watch(device: &wgpu::Device) -> Self {
        let failure = Self::default();
        let on_error = failure.clone();
        device.on_uncaptured_error(Arc::new(move |error| on_error.note(message(&error))));
        let on_lost = failure.clone();
        device.set_device_lost_callback(move |_, message| {
            on_lost.note(format!("the device was lost: {message}"));
        });
        failure
    }

    fn note(&self, message: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(message);
    }

    fn message(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

fn message(error: &wgpu::Error) -> String {
    match error {
        wgpu::Error::OutOfMemory { .. } => "it is out of memory".to_owned(),
        error => error.to_string(),
    }
}

impl Gpu {
    /// An error that names the adapter.
    pub(super) fn error(&self, message: impl std::fmt::Display) -> Error {
        Error::Gpu(format!("{}: {message}", self.name))
    }

    /// Makes a call of several steps. It fails if one of them does, or if the device reports
    /// an error meanwhile; the next call knows nothing of that, unless the device is lost.
    pub(super) fn call<T>(&self, steps: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
        use wgpu::ErrorFilter::{Internal, OutOfMemory, Validation};
        self.check()?;
        // What was refused for want of memory is later not valid either: the cause counts.
        let scopes = [Validation, Internal, OutOfMemory];
        let scopes = scopes.map(|filter| self.device.push_error_scope(filter));
        let result = steps();
        let mut reported = None;
        // Scopes end in the reverse order, each on this thread.
        for scope in scopes.into_iter().rev() {
            let error = pollster::block_on(scope.pop());
            reported = reported.or(error);
        }
        self.check()?;
        match reported {
            Some(error) => Err(self.error(message(&error))),
            None => result,
        }
    }

    /// Fails if the device is of no more use.
    fn check(&self) -> Result<(), Error> {
        self.failure.message().map_or(Ok(()), |message| Err(self.error(message)))
    }
}
