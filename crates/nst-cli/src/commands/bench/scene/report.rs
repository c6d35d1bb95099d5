//! What a bench says at its end.

use std::fmt;

use serde::Serialize;

use crate::{
    results::{Metric, PLAIN, Results, advice},
    words::counted,
};

/// The most methods that the text lists; the table has all.
const MOST_LISTED: usize = 12;

/// The means over the runs, and what they advise.
#[derive(Serialize)]
pub(super) struct Report {
    scene: String,
    width: u32,
    height: u32,
    /// The reference's own MSE, where it is known.
    reference_mse: Option<f64>,
    means: Vec<Mean>,
    failures: Vec<Failure>,
    /// Which method to pick, by MSE and by relMSE.
    advice: [String; 2],
    files: Vec<String>,
}

/// A method at one sample count.
#[derive(Serialize)]
struct Mean {
    method: String,
    spp: u32,
    runs: usize,
    mse: f64,
    relmse: f64,
    /// Relative to the plain estimates'.
    mse_ratio: Option<f64>,
    relmse_ratio: Option<f64>,
    seconds: Option<f64>,
}

#[derive(Serialize)]
struct Failure {
    method: String,
    spp: u32,
    why: String,
}

impl Report {
    pub(super) fn of(results: &Results, files: Vec<String>) -> Self {
        let summaries = results.summaries();
        let means = summaries.iter().filter_map(|it| {
            let (mse, relmse) = (it.error(Metric::Mse)?.mean, it.error(Metric::RelMse)?.mean);
            let plain = |metric| results.error(PLAIN, it.spp, metric);
            Some(Mean {
                method: it.method.clone(),
                spp: it.spp,
                runs: it.runs,
                mse,
                relmse,
                mse_ratio: plain(Metric::Mse).map(|plain| mse / plain),
                relmse_ratio: plain(Metric::RelMse).map(|plain| relmse / plain),
                seconds: it.seconds.total,
            })
        });
        let failures = summaries.iter().filter_map(|it| {
            let why = it.failure.clone()?;
            Some(Failure { method: it.method.clone(), spp: it.spp, why })
        });
        let [width, height] = results.size();
        Self {
            scene: results.scene().to_owned(),
            width,
            height,
            reference_mse: results.rows()[0].reference_mse,
            means: means.collect(),
            failures: failures.collect(),
            advice: [Metric::Mse, Metric::RelMse].map(|metric| advice(results, metric)),
            files,
        }
    }

    /// The methods with the lowest ratio at the largest sample count, plain and `auto` first.
    fn listed(&self) -> Vec<&str> {
        let largest = self.means.iter().map(|it| it.spp).max();
        let mut last: Vec<&Mean> = self.means.iter().filter(|it| Some(it.spp) == largest).collect();
        let rank = |it: &Mean| match &*it.method {
            PLAIN => -2.0,
            "auto" => -1.0,
            _ => it.relmse_ratio.unwrap_or(f64::INFINITY),
        };
        last.sort_by(|a, b| rank(a).total_cmp(&rank(b)));
        last.iter().map(|it| &*it.method).take(MOST_LISTED).collect()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, width, height, .. } = self;
        let runs = self.means.iter().map(|it| it.runs).max().unwrap_or_default();
        write!(f, "{scene}, {width}x{height} pixels, {}", counted(runs, "run"))?;
        match self.reference_mse {
            Some(own) => writeln!(f, "; the reference's own MSE is {own:.1e}")?,
            None => writeln!(f, "; the reference's own error is not known")?,
        }
        self.write_table(f)?;
        for failure in self.failures.iter().take(MOST_LISTED) {
            writeln!(f, "failed     {} at {} spp: {}", failure.method, failure.spp, failure.why)?;
        }
        if self.failures.len() > MOST_LISTED {
            writeln!(f, "failed     and {} more", self.failures.len() - MOST_LISTED)?;
        }
        writeln!(f, "by MSE     {}", self.advice[0])?;
        writeln!(f, "by relMSE  {}", self.advice[1])?;
        writeln!(f, "wrote      {}", self.files.join(", "))
    }
}

impl Report {
    fn write_table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let listed = self.listed();
        let mut counts: Vec<u32> = self.means.iter().map(|it| it.spp).collect();
        counts.sort_unstable();
        counts.dedup();
        let width = listed.iter().map(|name| name.chars().count()).max().unwrap_or_default();
        write!(f, "{:width$}", "")?;
        counts.iter().try_for_each(|spp| write!(f, "{:>18}", format!("{spp} spp")))?;
        writeln!(f)?;
        write!(f, "{:width$}", "")?;
        counts.iter().try_for_each(|_| write!(f, "{:>9}{:>9}", "MSE", "relMSE"))?;
        writeln!(f)?;
        for name in &listed {
            write!(f, "{name:width$}")?;
            for &spp in &counts {
                let found = self.means.iter().find(|it| it.method == *name && it.spp == spp);
                let cell = |value: Option<f64>| match value {
                    None => format!("{:>9}", "–"),
                    Some(value) if *name == PLAIN => format!("{value:>9.1e}"),
                    Some(value) => format!("{value:>9.3}"),
                };
                let (mse, relmse) = match found {
                    None => (None, None),
                    Some(it) if *name == PLAIN => (Some(it.mse), Some(it.relmse)),
                    Some(it) => (it.mse_ratio, it.relmse_ratio),
                };
                write!(f, "{}{}", cell(mse), cell(relmse))?;
            }
            writeln!(f)?;
        }
        let all: std::collections::BTreeSet<&str> =
            self.means.iter().map(|it| &*it.method).collect();
        let more = match all.len() - listed.len() {
            0 => String::new(),
            more => format!("; {} in the table", counted(more, "more method")),
        };
        writeln!(f, "'{PLAIN}' in numbers, the others relative to it{more}")
    }
}
