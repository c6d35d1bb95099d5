//! Signals that ask the program to end: Ctrl-C, SIGTERM and SIGHUP.
//!
//! A job that can save what it has done finishes its files after the first; everything
//! else ends at once, without temporary files.

use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use nst_files::output::abandon_all;

use crate::{error::Error, report::complain};

/// The exit code of the first signal, by which shells report it: 128 plus its number, 130
/// for Ctrl-C; 0 before there was any.
static ASKED: AtomicU8 = AtomicU8::new(0);

/// Whether the job saves what it has done after the first signal.
static FINISHES: AtomicBool = AtomicBool::new(false);

/// From now on, signals come here.
pub(crate) fn watch() -> Result<(), Error> {
    watch_signals().map_err(Error::Signals)
}

#[cfg(unix)]
fn watch_signals() -> std::io::Result<()> {
    use signal_hook::{
        consts::{SIGHUP, SIGINT, SIGTERM},
        iterator::Signals,
    };
    // `nohup` and shells' `&` make a program ignore some of them, which is to stay so.
    let wanted = [SIGINT, SIGTERM, SIGHUP].into_iter().filter(|&signal| !is_ignored(signal));
    let mut signals = Signals::new(wanted)?;
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in signals.forever() {
            note(128 + signal as u8);
        }
    })?;
    Ok(())
}

#[cfg(unix)]
#[allow(unsafe_code, reason = "there is no safe way to ask what a signal does")]
fn is_ignored(signal: i32) -> bool {
    let mut action = std::mem::MaybeUninit::<libc::sigaction>::uninit();
    // SAFETY: without a new action, sigaction only fills in the old one; where it fails, it
    // returns another number than 0, and nothing is read.
    unsafe {
        libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) == 0
            && action.assume_init().sa_sigaction == libc::SIG_IGN
    }
}

#[cfg(not(unix))]
fn watch_signals() -> std::io::Result<()> {
    ctrlc::set_handler(|| note(130)).map_err(std::io::Error::other)
}

/// A signal has come, which `exit_code` stands for.
fn note(exit_code: u8) {
    let is_first = ASKED.swap(exit_code, Ordering::Relaxed) == 0;
    if is_first && FINISHES.load(Ordering::Relaxed) {
        complain("finishing this pass and the files; press Ctrl-C again to quit at once");
    } else {
        abandon_all();
        std::process::exit(exit_code.into());
    }
}

/// From now on, a first signal is only noted, see [`asked`]: the job will save what it has
/// done.
pub(crate) fn finish_on_signal() {
    FINISHES.store(true, Ordering::Relaxed);
}

/// Whether a signal has asked the job to end.
pub(crate) fn asked() -> bool {
    ASKED.load(Ordering::Relaxed) != 0
}

/// The exit code of a job that a signal has ended early.
pub(crate) fn exit_code() -> u8 {
    ASKED.load(Ordering::Relaxed)
}
