//! Ctrl-C: the first asks the job to end in good order, the second ends it at once.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::{error::Error, report::complain};

/// What a shell reports of a program that SIGINT has ended: 128 + 2.
pub(crate) const EXIT_CODE: u8 = 130;

static ASKED: AtomicBool = AtomicBool::new(false);

/// From now on, Ctrl-C is noted. A second one ends the process,
/// which leaves temporary files behind.
pub(crate) fn watch() -> Result<(), Error> {
    ctrlc::set_handler(|| {
        if ASKED.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_CODE.into());
        }
        complain("finishing this pass and the files; press Ctrl-C again to quit at once");
    })?;
    Ok(())
}

/// Whether the job is to end.
pub(crate) fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}
