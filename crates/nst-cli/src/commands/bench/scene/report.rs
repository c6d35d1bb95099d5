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
    notes: Vec<String>,
    files: Vec<String>,
    #[serde(skip)]
    runs: String,
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
    pub(super) fn of(results: &Results, notes: Vec<String>, files: Vec<String>) -> Self {
        let summaries = results.summaries();
        let means = summaries.iter().filter_map(|it| {
            let (mse, relmse) = (it.error(Metric::Mse)?.mean, it.error(Metric::RelMse)?.mean);
            let plain = |metric| results.error(PLAIN, it.spp, metric).filter(|&plain| plain > 0.0);
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
            notes,
            files,
            runs: results.runs(),
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
        write!(f, "{scene}, {width}x{height} pixels, {}", self.runs)?;
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
        for note in &self.notes {
            writeln!(f, "note       {note}")?;
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
                let cell = |value: Option<f64>| format!("{:>9}", cell(value, *name == PLAIN));
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

/// A number of the printed table, which has 8 columns for it.
fn cell(value: Option<f64>, scientific: bool) -> String {
    match value.filter(|value| value.is_finite()) {
        None => "–".to_owned(),
        Some(value) if scientific => format!("{value:.1e}"),
        // A ratio that is large, or would be rounded to 0.
        Some(value) if !(1e-3..1e4).contains(&value.abs()) && value != 0.0 => {
            format!("{value:.1e}")
        }
        Some(value) => format!("{value:.3}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_fit_their_columns() {
        for (value, plain, other) in [
            (Some(0.12345), "1.2e-1", "0.123"),
            (Some(1234.5), "1.2e3", "1234.500"),
            (Some(-123_456.7), "-1.2e5", "-1.2e5"),
            (Some(1.5e-7), "1.5e-7", "1.5e-7"),
            (Some(0.0), "0.0e0", "0.000"),
            (Some(f64::NAN), "–", "–"),
            (Some(f64::INFINITY), "–", "–"),
            (None, "–", "–"),
        ] {
            assert_eq!([cell(value, true), cell(value, false)], [plain, other]);
        }
    }
}
