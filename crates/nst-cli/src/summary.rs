//! What `nst render` and `nst transform` report.

use std::{
    borrow::Cow,
    fmt,
    time::{Duration, Instant},
};

use nst_core::{Error as CoreError, Estimates, SequenceBatch, Status, Strips, guard::Judgement};
use serde::Serialize;

use crate::{
    args::{CLOSED, LEARNED},
    method::Method,
    words::list,
};

/// The times and counts of a job.
#[derive(Debug, Serialize)]
pub(crate) struct Summary {
    /// Of a rendering, in the files: fewer than asked for where it was stopped early.
    samples_per_pixel: Option<u32>,
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
    /// Why this transformation was chosen, or what it does, or why the plain estimates stay.
    reason: String,
    /// Whether they all do, as a method that measures its own gain found none.
    #[serde(skip)]
    plain_kept: bool,
    /// The experts of a transformation that blends some.
    experts: Vec<Expert>,
    /// What weighs them: `closed` or `learned`.
    guard: Option<&'static str>,
    /// What it says of its own MSE, relative to that of the plain estimate, with the ends of the
    /// 95 % interval.
    predicted_ratio: Option<f64>,
    predicted_low: Option<f64>,
    predicted_high: Option<f64>,
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

/// An expert, and the mean of its weight over the lanes, from 0 to 1.
#[derive(Debug, Serialize)]
struct Expert {
    name: String,
    weight: f64,
}

/// What became of the lanes of one or several batches.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outcome {
    /// What the method says of its own gain, if it measures it.
    pub(crate) judgement: Option<Judgement>,
    lanes: usize,
    skipped: usize,
    fallen_back: usize,
}

impl Outcome {
    pub(crate) fn new(judgement: Option<Judgement>) -> Self {
        Self { judgement, ..Self::default() }
    }

    pub(crate) fn add(&mut self, estimates: &Estimates) {
        self.lanes += estimates.values().len();
        self.skipped += estimates.count(Status::Constant);
        self.fallen_back += estimates.fallen_back();
    }
}

/// Why a method that measures its own gain changes no lane, if it changes none.
pub(crate) fn why_kept(judgement: &Judgement) -> Option<String> {
    match (judgement.experts.is_empty(), judgement.notes.first()) {
        (true, Some(why)) => Some(why.clone()),
        _ if judgement.experts.iter().all(|(_, weight)| *weight == 0.0) => {
            Some("no expert gains what is beyond chance".to_owned())
        }
        _ => None,
    }
}

/// What weighs experts, as `--guard` calls it.
pub(crate) fn weighed_by(judgement: &Judgement) -> &'static str {
    if judgement.learned { LEARNED } else { CLOSED }
}

/// A rendering's part of the summary.
pub(crate) struct RenderStats {
    /// Per pixel, those of a rendering that was continued included.
    pub(crate) samples: u32,
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
        outcome: Outcome,
        files: Vec<String>,
        (mut notes, said): (Vec<String>, usize),
    ) -> Summary {
        let Outcome { judgement, lanes, skipped, fallen_back } = outcome;
        let judgement = judgement.as_ref();
        let kept = judgement.and_then(why_kept);
        // What is the reason is no further note.
        let further = judgement.into_iter().flat_map(|it| it.notes.iter().cloned());
        notes.extend(further.filter(|note| kept.as_ref() != Some(note)));
        let experts = judgement.into_iter().flat_map(|it| it.experts.iter().cloned());
        let rate = |render: &RenderStats| render.paths as f64 / render.time.as_secs_f64();
        Summary {
            samples_per_pixel: render.as_ref().map(|render| render.samples),
            render_seconds: render.as_ref().map(|render| render.time.as_secs_f64()),
            build_seconds: render.as_ref().map(|render| render.build_time.as_secs_f64()),
            transform_seconds: self.transform.as_secs_f64(),
            io_seconds: self.io.as_secs_f64(),
            total_seconds: self.start.elapsed().as_secs_f64(),
            paths_per_second: render.as_ref().map(rate),
            backend: method.backend(),
            adapter: method.adapter(),
            transform: method.name.clone(),
            plain_kept: kept.is_some(),
            reason: kept.map_or_else(
                || method.reason.into(),
                |why| format!("the plain estimates stay: {why}"),
            ),
            experts: experts.map(|(name, weight)| Expert { name, weight }).collect(),
            guard: judgement.map(weighed_by),
            predicted_ratio: judgement.map(|it| it.ratio),
            predicted_low: judgement.map(|it| it.interval[0]),
            predicted_high: judgement.map(|it| it.interval[1]),
            lanes,
            lanes_skipped: skipped,
            lanes_fallen_back: fallen_back,
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

impl Summary {
    /// How much the experts are trusted, and what that gains.
    fn predicted(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let figures = [self.predicted_ratio, self.predicted_low, self.predicted_high];
        let [Some(ratio), Some(low), Some(high)] = figures else { return Ok(()) };
        let percent = |expert: &Expert| (100.0 * expert.weight).round();
        let trusted = self.experts.iter().filter(|expert| percent(expert) > 0.0);
        let trusted = trusted.map(|it| format!("{} by {} %", it.name, percent(it)));
        let trusted = list(&trusted.collect::<Vec<_>>(), "no expert by as much as 1 %");
        let by = if self.guard == Some(LEARNED) { ", as a network says" } else { "" };
        writeln!(f, "           trusts {trusted}, on average over the lanes{by}")?;
        writeln!(
            f,
            "           predicts {ratio:.2} of the plain estimates' MSE (95 %: {low:.2} to {high:.2})"
        )
    }

    /// How many lanes keep the plain estimate where the others do not.
    fn kept(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut keep = |count: usize, why: &str| match count {
            0 => Ok(()),
            1 => writeln!(f, "           1 keeps the plain estimate: {why}"),
            _ => writeln!(f, "           {count} keep the plain estimate: {why}"),
        };
        keep(self.lanes_skipped, "all terms are equal")?;
        keep(self.lanes_fallen_back, "the method breaks down")
    }
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
            if !self.plain_kept {
                self.predicted(f)?;
                self.kept(f)?;
            }
        }
        for note in &self.notes[self.said..] {
            writeln!(f, "note       {note}")?;
        }
        writeln!(f, "wrote      {} ({:.2} s)", self.files.join(", "), self.io_seconds)?;
        write!(f, "total      {:.2} s", self.total_seconds)
    }
}
