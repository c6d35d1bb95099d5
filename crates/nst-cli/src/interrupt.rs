//! Ctrl-C: the first asks the job to finish its files and end, the second ends it at once.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::{error::Error, report::complain};

/// The exit code by which shells report that SIGINT ended a program: 128 + 2.
pub(crate) const EXIT_CODE: u8 = 130;

static ASKED: AtomicBool = AtomicBool::new(false);

/// From now on, a first Ctrl-C is only noted: see [`asked`]. A second one ends the process,
/// and leaves temporary files behind.
pub(crate) fn watch() -> Result<(), Error> {
    ctrlc::set_handler(|| {
        if ASKED.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE.into());
        }
        complain("finishing this pass and the files; press Ctrl-C again to quit at once");
    })?;
    Ok(())
}

/// Whether Ctrl-C has asked the job to end.
pub(crate) fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}
