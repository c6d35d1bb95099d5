//! The plots of a chart: error against time, error against samples, and methods at equal time.

use super::{
    canvas::Stroke,
    palette::Ink,
    plot::{Dot, Guide, Plot, Series},
    select::{Styles, display_name},
};
use crate::results::{
    Curve, Curves, PLAIN, Point, budgets,
    text::{number, seconds},
};

/// The most budgets that are compared, and the most sample counts that have ticks.
const MOST_TICKS: usize = 9;

/// Error against the time of the whole job.
pub(super) fn against_time(curves: &Curves, styles: &Styles, reference_mse: Option<f64>) -> Plot {
    let dot = |curve: &Curve, point: &Point| {
        let (seconds, error) = point.place()?;
        let label = describe(curves, curve, point);
        let on_front = point.on_front;
        Some(Dot { at: [seconds, error], interval: None, on_front, label })
    };
    let mut series = series(curves, styles, dot);
    for series in &mut series {
        series.dots.sort_by(|a, b| a.at[0].total_cmp(&b.at[0]));
    }
    Plot {
        title: format!("{} against time", curves.metric.name()),
        x_title: "seconds for the whole job: load, render, transform, write",
        guides: reference(&series, reference_mse),
        series,
        front: true,
        empty: "no time was measured",
        ..Plot::default()
    }
}

/// Error against samples per pixel, with 95 % intervals.
pub(super) fn against_samples(
    curves: &Curves,
    styles: &Styles,
    reference_mse: Option<f64>,
) -> Plot {
    let dot = |curve: &Curve, point: &Point| {
        let label = describe(curves, curve, point);
        let at = [f64::from(point.spp), point.error];
        let usable = at.iter().all(|value| *value > 0.0);
        usable.then_some(Dot { at, interval: point.interval, on_front: false, label })
    };
    let series = series(curves, styles, dot);
    let mut counts: Vec<f64> =
        series.iter().flat_map(|series| &series.dots).map(|dot| dot.at[0]).collect();
    counts.sort_by(f64::total_cmp);
    counts.dedup();
    let mut guides = reference(&series, reference_mse);
    guides.extend(theory(curves));
    Plot {
        title: format!("{} against samples", curves.metric.name()),
        x_title: "samples per pixel",
        x_ticks: (counts.len() <= MOST_TICKS).then_some(counts),
        series,
        guides,
        empty: "no error above 0 was measured",
        ..Plot::default()
    }
}

/// The error relative to the plain estimate's for some budgets of time.
pub(super) fn at_equal_time(curves: &Curves, styles: &Styles) -> Plot {
    let all = budgets(curves);
    let every = all.len().div_ceil(MOST_TICKS).max(1);
    let budgets: Vec<f64> = all.into_iter().step_by(every).collect();
    let plain = curves.plain();
    let of_method = |curve: &Curve| {
        let name = display_name(&curve.method);
        let dots = budgets.iter().filter_map(|&budget| {
            let ratio = curve.error_at(budget)? / plain?.error_at(budget)?;
            let ratio = if curve.method == PLAIN { 1.0 } else { ratio };
            if !(ratio.is_finite() && ratio > 0.0) {
                return None;
            }
            let label = format!(
                "{name} in {}: {} of the plain estimate's {}",
                seconds(budget),
                number(ratio, 3),
                curves.metric.name()
            );
            Some(Dot { at: [budget, ratio], interval: None, on_front: false, label })
        });
        let dots: Vec<Dot> = dots.collect();
        (!dots.is_empty()).then(|| Series { name, style: styles.of(&curve.method), dots })
    };
    let series = curves.plain().into_iter().chain(curves.others()).filter_map(of_method).collect();
    Plot {
        title: format!("{} at equal time, relative to plain sampling", curves.metric.name()),
        x_title: "seconds for the whole job",
        x_ticks: Some(budgets.clone()),
        series,
        better_below: Some(1.0),
        empty: "no time was measured both of plain sampling and of another method",
        ..Plot::default()
    }
}

/// The methods' curves, the plain estimate first.
fn series(
    curves: &Curves,
    styles: &Styles,
    dot: impl Fn(&Curve, &Point) -> Option<Dot>,
) -> Vec<Series> {
    let ordered = curves.plain().into_iter().chain(curves.others());
    let all = ordered.map(|curve| Series {
        name: display_name(&curve.method),
        style: styles.of(&curve.method),
        dots: curve.points.iter().filter_map(|point| dot(curve, point)).collect(),
    });
    all.filter(|series| !series.dots.is_empty()).collect()
}

fn describe(curves: &Curves, curve: &Curve, point: &Point) -> String {
    let name = display_name(&curve.method);
    let error = format!("{} {}", curves.metric.name(), number(point.error, 3));
    let interval = point.interval.map_or(String::new(), |[low, high]| {
        format!(" (95 %: {} to {})", number(low, 3), number(high, 3))
    });
    let time = point.seconds.map_or(String::new(), |time| format!(", {}", seconds(time)));
    let front = if point.on_front { ", on the Pareto front" } else { "" };
    format!("{name} at {} spp: {error}{interval}{time}{front}", point.spp)
}

/// How the plain estimate's error falls in theory, from its first point.
fn theory(curves: &Curves) -> Option<Guide> {
    let points = &curves.plain()?.points;
    let (first, last) = (points.first()?, points.last()?);
    if first.spp == last.spp || first.error <= 0.0 {
        return None;
    }
    let ratio = f64::from(last.spp) / f64::from(first.spp);
    let slope = curves.metric.slope();
    let end = first.error * ratio.powf(slope);
    (end > 0.0).then(|| Guide {
        name: format!("slope {} of plain sampling", slope.to_string().replace('-', "−")),
        ends: [[f64::from(first.spp), first.error], [f64::from(last.spp), end]],
        stroke: Stroke { ink: Ink::Soft, width: 1.2, dash: &[1.5, 3.0] },
    })
}

/// The reference's own MSE.
fn reference(series: &[Series], reference_mse: Option<f64>) -> Vec<Guide> {
    let places = || series.iter().flat_map(|series| &series.dots).map(|dot| dot.at[0]);
    let (first, last) =
        (places().fold(f64::INFINITY, f64::min), places().fold(f64::NEG_INFINITY, f64::max));
    let level = |mse| Guide {
        name: "the reference's own MSE".to_owned(),
        ends: [[first, mse], [last, mse]],
        stroke: Stroke { ink: Ink::Soft, width: 1.0, dash: &[6.0, 4.0] },
    };
    reference_mse.map(level).into_iter().collect()
}
