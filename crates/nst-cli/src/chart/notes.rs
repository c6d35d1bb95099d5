//! What stands in words above and below the plots.

use std::collections::BTreeMap;

use super::select::{Styles, display_name};
use crate::results::{Curve, Curves, Metric, Results, Summary};

/// The most reasons of failure that are listed.
const MOST_FAILURES: usize = 12;

/// What was measured, and on what: one line.
pub(super) fn subtitle(results: &Results) -> String {
    let [width, height] = results.size();
    let mut parts = vec![format!("{width} × {height} pixels")];
    if results.summaries().iter().any(|it| it.runs > 0) {
        parts.push(format!("{} per point", results.runs()));
    }
    let known = |values: Vec<&str>| {
        let known: Vec<_> = values.into_iter().filter(|value| !value.is_empty()).collect();
        (!known.is_empty()).then(|| known.join("; "))
    };
    parts.extend(known(results.distinct(|row| &row.machine)));
    let threads = results.threads();
    if !threads.is_empty() {
        let noun = if threads == [1] { "thread" } else { "threads" };
        let threads: Vec<_> = threads.iter().map(u32::to_string).collect();
        parts.push(format!("{} {noun}", threads.join(" and ")));
    }
    parts.extend(known(results.distinct(|row| row.adapter.as_deref().unwrap_or_default())));
    parts.extend(
        known(results.distinct(|row| &row.version)).map(|version| format!("nst {version}")),
    );
    parts.join(" · ")
}

/// How to read the plots, what is not in them, and why: paragraphs.
pub(super) fn below(results: &Results, all: &[Curves], styles: &Styles) -> Vec<String> {
    let several = results.summaries().iter().any(|summary| summary.runs > 1);
    let points = if several {
        "Points are means over the runs; bars are 95 % intervals of the mean (Student’s t over the \
         runs); times are medians over the runs."
    } else {
        "Points are single runs, so that nothing is known of their scatter."
    };
    let front = "On the Pareto front, marked by rings, nothing is both faster and more accurate.";
    let mut notes = vec![format!("{points} {front}")];
    if all.iter().any(goes_on) {
        notes.push(
            "Where plain sampling was not measured for as long as others, its error goes on in \
             inverse proportion to its samples."
                .to_owned(),
        );
    }
    notes.extend(results.notes());
    notes.extend(muted(all, styles));
    notes.extend(all.iter().filter_map(not_above_zero));
    notes.extend(without_time(results));
    notes.extend(failures(results.summaries()));
    notes
}

/// Whether other methods took longer than plain sampling, which is squared error.
fn goes_on(curves: &Curves) -> bool {
    let longest = |curve: &Curve| curve.times().last();
    let plain = curves.plain().and_then(longest);
    let beyond = |time: f64| plain.is_some_and(|plain| plain < time);
    let slowest = curves.others().filter_map(longest).max_by(f64::total_cmp);
    slowest.is_some_and(|time| {
        beyond(time) && curves.plain().is_some_and(|plain| plain.error_at(time).is_some())
    })
}

fn muted(all: &[Curves], styles: &Styles) -> Option<String> {
    let mut names: Vec<String> = Vec::new();
    let muted = all.iter().flat_map(Curves::others);
    for curve in muted.filter(|curve| styles.of(&curve.method).is_muted()) {
        let name = display_name(&curve.method);
        if !names.contains(&name) && names.len() < 100 {
            names.push(name);
        }
    }
    (!names.is_empty()).then(|| format!("In grey, where within a plot: {}.", names.join(", ")))
}

/// What has no place on a logarithmic axis.
fn not_above_zero(curves: &Curves) -> Option<String> {
    let points = curves.curves.iter().flat_map(|curve| {
        let below = curve.points.iter().filter(|point| point.error <= 0.0);
        below.map(|point| format!("{} at {} spp", display_name(&curve.method), point.spp))
    });
    let points: Vec<String> = points.collect();
    let some = points.iter().take(MOST_FAILURES).cloned().collect::<Vec<_>>().join(", ");
    let more = match points.len().saturating_sub(MOST_FAILURES) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    (!points.is_empty()).then(|| {
        format!(
            "Left out, as the measured {} is 0 or less, too small for this reference: {some}{more}.",
            curves.metric.name()
        )
    })
}

fn without_time(results: &Results) -> Option<String> {
    let mut names: Vec<String> = Vec::new();
    for summary in results.summaries() {
        let measured = Metric::ALL.iter().any(|metric| summary.error(*metric).is_some());
        let timed = summary.seconds.total.is_some_and(|seconds| seconds > 0.0);
        let name = display_name(&summary.method);
        if measured && !timed && !names.contains(&name) {
            names.push(name);
        }
    }
    (!names.is_empty())
        .then(|| format!("Without a time, and so only against samples: {}.", names.join(", ")))
}

/// One paragraph for each method and reason.
fn failures(summaries: &[Summary]) -> Vec<String> {
    let mut reasons: BTreeMap<(&str, &str), Vec<String>> = BTreeMap::new();
    for summary in summaries {
        if let Some(why) = &summary.failure {
            reasons.entry((&summary.method, why)).or_default().push(summary.spp.to_string());
        }
    }
    let more = reasons.len().saturating_sub(MOST_FAILURES);
    let paragraph = |((method, why), counts): ((&str, &str), Vec<String>)| {
        let counts = &counts[..counts.len().min(MOST_FAILURES)];
        format!("Failed: {} at {} spp: {why}", display_name(method), counts.join(", "))
    };
    let mut notes: Vec<String> = reasons.into_iter().take(MOST_FAILURES).map(paragraph).collect();
    if more > 0 {
        notes.push(format!("{more} more failures are in the table."));
    }
    notes
}
