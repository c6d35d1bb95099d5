//! What `nst render` and `nst transform` report.

use std::{
    borrow::Cow,
    fmt,
    time::{Duration, Instant},
};

use nst_core::{Error as CoreError, Estimates, SequenceBatch, Status, Strips};
use serde::Serialize;

use crate::method::Method;

/// The times and counts of a job.
#[derive(Debug, Serialize)]
pub(crate) struct Summary {
    render_seconds: Option<f64>,
    /// Part of `render_seconds`.
    build_seconds: Option<f64>,
    transform_seconds: f64,
    io_seconds: f64,
    total_seconds: f64,
    paths_per_second: Option<f64>,
    backend: &'static str,
    adapter: Option<String>,
    transform: String,
    /// Why this transformation was chosen.
    reason: String,
    lanes: usize,
    lanes_skipped: usize,
    lanes_fallen_back: usize,
    /// The files that were written.
    files: Vec<String>,
    /// What was assumed, and what was lost.
    notes: Vec<String>,
    /// How many of the notes have been printed before.
    #[serde(skip)]
    said: usize,
}

/// How many lanes one or several batches have, by status.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LaneCounts {
    lanes: usize,
    skipped: usize,
    fallen_back: usize,
}

impl LaneCounts {
    pub(crate) fn add(&mut self, estimates: &Estimates) {
        self.lanes += estimates.values().len();
        self.skipped += estimates.count(Status::Constant);
        self.fallen_back += estimates.fallen_back();
    }
}

/// A rendering's part of the summary.
pub(crate) struct RenderStats {
    pub(crate) time: Duration,
    pub(crate) build_time: Duration,
    pub(crate) paths: u64,
}

/// Collects the times of the parts of a job.
pub(crate) struct Stopwatch {
    start: Instant,
    pub(crate) transform: Duration,
    pub(crate) io: Duration,
}

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self { start: Instant::now(), transform: Duration::ZERO, io: Duration::ZERO }
    }

    pub(crate) fn summary(
        &self,
        render: Option<RenderStats>,
        method: &Method,
        counts: LaneCounts,
        files: Vec<String>,
        (notes, said): (Vec<String>, usize),
    ) -> Summary {
        let rate = |render: &RenderStats| render.paths as f64 / render.time.as_secs_f64();
        Summary {
            render_seconds: render.as_ref().map(|render| render.time.as_secs_f64()),
            build_seconds: render.as_ref().map(|render| render.build_time.as_secs_f64()),
            transform_seconds: self.transform.as_secs_f64(),
            io_seconds: self.io.as_secs_f64(),
            total_seconds: self.start.elapsed().as_secs_f64(),
            paths_per_second: render.as_ref().map(rate),
            backend: method.backend(),
            adapter: method.adapter(),
            transform: method.name.clone(),
            reason: method.reason.clone(),
            lanes: counts.lanes,
            lanes_skipped: counts.skipped,
            lanes_fallen_back: counts.fallen_back,
            files,
            notes,
            said,
        }
    }
}

/// Strips, and the time that it takes to read them.
pub(crate) struct TimedStrips<'a> {
    pub(crate) strips: &'a mut dyn Strips,
    pub(crate) time: Duration,
}

impl Strips for TimedStrips<'_> {
    fn rewind(&mut self, halo: u32) -> Result<(), CoreError> {
        self.strips.rewind(halo)
    }

    fn next_strip(&mut self) -> Result<Option<Cow<'_, SequenceBatch>>, CoreError> {
        timed(&mut self.time, || self.strips.next_strip())
    }
}

/// Runs `work` and adds the time it took to `total`.
pub(crate) fn timed<T>(total: &mut Duration, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    *total += start.elapsed();
    result
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let (Some(seconds), Some(rate)) = (self.render_seconds, self.paths_per_second) {
            writeln!(f, "render     {seconds:.2} s, {:.2} million paths per second", rate / 1e6)?;
        }
        writeln!(f, "transform  {} ({})", self.transform, self.reason)?;
        if self.transform != "none" {
            let on = self.adapter.as_deref().unwrap_or("the CPU");
            let Self { transform_seconds, lanes, .. } = self;
            writeln!(
                f,
                "           {transform_seconds:.3} s on {on}, for {lanes} sequences, one per pixel \
                 and channel",
            )?;
            let keep = |count: usize, why: &str| match count {
                0 => String::new(),
                1 => format!("           1 keeps the plain estimate: {why}\n"),
                _ => format!("           {count} keep the plain estimate: {why}\n"),
            };
            f.write_str(&keep(self.lanes_skipped, "all terms are equal"))?;
            f.write_str(&keep(self.lanes_fallen_back, "the method breaks down"))?;
        }
        for note in &self.notes[self.said..] {
            writeln!(f, "note       {note}")?;
        }
        writeln!(f, "wrote      {} ({:.2} s)", self.files.join(", "), self.io_seconds)?;
        write!(f, "total      {:.2} s", self.total_seconds)
    }
}
