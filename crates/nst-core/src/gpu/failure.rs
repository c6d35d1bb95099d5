//! What goes wrong on a device: an error belongs to the call during which it came up; only
//! the loss of the device is for good.

use std::sync::{Arc, Mutex, PoisonError};

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

    pub(super) fn message(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

pub(super) fn message(error: &wgpu::Error) -> String {
    match error {
        wgpu::Error::OutOfMemory { .. } => "it is out of memory".to_owned(),
        error => error.to_string(),
    }
}
