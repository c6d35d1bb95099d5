//! What a job is doing, on a terminal: one line that is replaced, and is gone at the end. In
//! a pipe there is none.

use std::{
    fmt::Write,
    sync::{Mutex, Once, PoisonError},
    time::Duration,
};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use crate::{args::CommonArgs, words::duration};

/// How often the line is drawn, also while nothing is counted.
const TICK: Duration = Duration::from_millis(200);

/// The line that is on the terminal.
static SHOWN: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// A line on the terminal, which vanishes with this value. There is one at a time.
pub(crate) struct Progress {
    bar: ProgressBar,
    /// How it looks once something is counted, and the first time that it is.
    counting: Option<ProgressStyle>,
    first: Once,
}

impl Progress {
    /// A step of a job of which no part is counted: what it does, and for how long.
    pub(crate) fn step(what: impl Into<String>, common: &CommonArgs) -> Self {
        Self::show(ProgressBar::no_length(), what.into(), None, common)
    }

    /// A step in which [`Self::advance`] counts up to `total`; before the first time, it is
    /// doing something else.
    pub(crate) fn count(before: &str, what: &str, total: u64, common: &CommonArgs) -> Self {
        let template = format!("{what:10} {{wide_bar}} {{percent:>3}} %, {{left}} left");
        let left = |state: &ProgressState, text: &mut dyn Write| {
            let left = time_left(state.elapsed(), state.pos(), state.len().unwrap_or_default());
            // Writing to a string does not fail.
            let _ = text.write_str(&left.map_or("? s".into(), duration));
        };
        let style = style(&template).with_key("left", left);
        Self::show(ProgressBar::new(total), before.into(), Some(style), common)
    }

    fn show(
        bar: ProgressBar,
        before: String,
        counting: Option<ProgressStyle>,
        common: &CommonArgs,
    ) -> Self {
        let bar = if common.quiet || common.json { ProgressBar::hidden() } else { bar };
        let since = |state: &ProgressState, text: &mut dyn Write| {
            // What takes no second needs no time.
            if state.elapsed().as_secs() > 0 {
                let _ = text.write_str(&duration(state.elapsed()));
            }
        };
        bar.set_style(style("{wide_msg} {since}").with_key("since", since));
        bar.set_message(before);
        bar.enable_steady_tick(TICK);
        *shown() = Some(bar.clone());
        Self { bar, counting, first: Once::new() }
    }

    /// Counts what is done.
    pub(crate) fn advance(&self, done: u64) {
        self.first.call_once(|| {
            // What is left is judged by what was counted, not by what came before.
            self.bar.reset_elapsed();
            if let Some(style) = &self.counting {
                self.bar.set_style(style.clone());
            }
        });
        self.bar.inc(done);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        *shown() = None;
        self.bar.finish_and_clear();
    }
}

/// Prints something above the line that is on the terminal.
pub(crate) fn above<T>(print: impl FnOnce() -> T) -> T {
    let bar = shown().clone();
    match bar {
        Some(bar) => bar.suspend(print),
        None => print(),
    }
}

fn shown() -> std::sync::MutexGuard<'static, Option<ProgressBar>> {
    SHOWN.lock().unwrap_or_else(PoisonError::into_inner)
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the templates are constants")
}

/// How long the rest takes if it goes on as it has gone so far; `None` before anything is
/// done.
fn time_left(spent: Duration, done: u64, total: u64) -> Option<Duration> {
    let share = done as f64 / total as f64;
    Duration::try_from_secs_f64(spent.as_secs_f64() * (1.0 / share - 1.0)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_in_proportion() {
        let left = |seconds, done, total| time_left(Duration::from_secs(seconds), done, total);
        assert_eq!(left(5, 1, 4), Some(Duration::from_secs(15)));
        assert_eq!(left(5, 4, 4), Some(Duration::ZERO));
        assert_eq!([left(5, 0, 4), left(5, 0, 0)], [None, None]);
    }
}
