//! One sentence for users: which method for which budget of time.

use super::{
    curves::{Curve, Curves},
    metric::Metric,
    row::PLAIN,
    scene::Results,
    text::{number, seconds},
};

/// A method wins if its error is below this share of the plain estimate's: the difference must
/// be worth the trouble, and be more than what is left of noise after some runs.
const WINS: f64 = 0.99;

/// The most budgets that are not round.
const MOST_TIMES: usize = 9;

/// Which method to pick for a budget of time on this scene, and from where on plain sampling
/// wins: a sentence.
pub(crate) fn advice(results: &Results, metric: Metric) -> String {
    let curves = results.curves(metric);
    let measured = |curve: &&Curve| curve.times().next().is_some();
    let others: Vec<&Curve> = curves.others().filter(measured).collect();
    let plain = curves.plain().filter(measured);
    match (plain, &others[..]) {
        (None, []) => nothing(results, &curves),
        (None, _) => match curves.plain() {
            None => "Plain sampling was not measured; nothing can be compared with it.".to_owned(),
            Some(plain) => format!("Of plain sampling, {}", missing([plain], metric)),
        },
        (Some(_), []) if curves.others().next().is_some() => {
            format!("Of all methods but plain sampling, {}", missing(curves.others(), metric))
        }
        (Some(_), []) => "Only plain sampling was measured; there is nothing to choose.".to_owned(),
        (Some(plain), _) => {
            let duels = Duels { plain, others, metric };
            let knots = duels.knots();
            if knots.is_empty() { duels.same_count() } else { duels.sentence(&knots) }
        }
    }
}

/// Budgets of time for which methods can be compared: round numbers (1, 2, 5, 10, …) at which
/// the plain estimate and another method were measured, from the smallest. If there are not two,
/// times that were measured, at most nine.
pub(crate) fn budgets(curves: &Curves) -> Vec<f64> {
    let Some(plain) = curves.plain() else { return Vec::new() };
    let duels = Duels { plain, others: curves.others().collect(), metric: curves.metric };
    duels.budgets(&duels.knots())
}

/// Why there is nothing to compare.
fn nothing(results: &Results, curves: &Curves) -> String {
    let name = curves.metric.name();
    let failure =
        results.summaries().iter().find_map(|it| Some((&it.method, it.failure.as_ref()?)));
    match failure {
        _ if !curves.curves.is_empty() => {
            format!("Nothing can be compared: {}", missing(&curves.curves, curves.metric))
        }
        Some((method, why)) => format!("No {name} was measured; '{method}' failed: {why}"),
        None => format!("No {name} was measured."),
    }
}

/// What these methods lack, of which no point has a place, and what to do: the end of a
/// sentence.
fn missing<'a>(curves: impl IntoIterator<Item = &'a Curve>, metric: Metric) -> String {
    let name = metric.name();
    let mut points = curves.into_iter().flat_map(|curve| &curve.points);
    if points.any(|point| point.error > 0.0) {
        "no time is known, only errors; files of other programs say it by the attribute \
         renderTimeSeconds."
            .to_owned()
    } else {
        format!(
            "no {name} above 0 was measured; a reference of more samples per pixel \
             (--reference-spp), or more runs, would show it."
        )
    }
}

/// The plain estimate against each of the others.
struct Duels<'a> {
    plain: &'a Curve,
    others: Vec<&'a Curve>,
    metric: Metric,
}

impl<'a> Duels<'a> {
    /// The measured times at which the plain estimate and another method have an error. Between
    /// two of them all logarithms are linear, so that who wins between wins at one of them too.
    fn knots(&self) -> Vec<f64> {
        let all = self.others.iter().chain([&self.plain]);
        let mut times: Vec<f64> = all.flat_map(|it| it.times()).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        let mut spans: Vec<[f64; 2]> = self.others.iter().filter_map(|it| it.span()).collect();
        spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut spans = spans.into_iter().peekable();
        let mut end = f64::NEG_INFINITY;
        times.retain(|&time| {
            while let Some(span) = spans.next_if(|span| span[0] <= time) {
                end = end.max(span[1]);
            }
            time <= end && self.plain.error_at(time).is_some()
        });
        times
    }

    /// This method alone against the plain estimate.
    fn alone(&self, method: &'a Curve) -> Duels<'a> {
        Duels { plain: self.plain, others: vec![method], metric: self.metric }
    }

    /// The best of the other methods, its error, and the plain estimate's, if both are known.
    fn best_other(&self, time: f64) -> Option<(&'a Curve, f64, f64)> {
        let plain = self.plain.error_at(time)?;
        let others = self.others.iter().filter_map(|it| Some((*it, it.error_at(time)?, plain)));
        others.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// The best of the other methods, if it wins.
    fn winner(&self, time: f64) -> Option<(&'a Curve, f64, f64)> {
        self.best_other(time).filter(|(_, error, plain)| *error < WINS * plain)
    }

    /// As [`budgets`].
    fn budgets(&self, knots: &[f64]) -> Vec<f64> {
        let (Some(first), Some(last)) = (knots.first(), knots.last()) else { return Vec::new() };
        let decades = first.log10().floor() as i32..=last.log10().ceil() as i32;
        let round =
            decades.flat_map(|power| [1.0, 2.0, 5.0].map(|digit| digit * 10_f64.powi(power)));
        let round: Vec<f64> = round.filter(|&time| self.best_other(time).is_some()).collect();
        if round.len() > 1 {
            return round;
        }
        let every = knots.len().div_ceil(MOST_TIMES);
        knots.iter().copied().step_by(every).collect()
    }

    /// The knots at which another method wins.
    fn wins(&self) -> Vec<f64> {
        self.knots().into_iter().filter(|&time| self.winner(time).is_some()).collect()
    }

    fn sentence(&self, knots: &[f64]) -> String {
        let mut won = self.budgets(knots);
        won.retain(|&time| self.winner(time).is_some());
        if won.is_empty() {
            won.extend(self.others.iter().flat_map(|method| self.alone(method).wins()));
            won.sort_by(f64::total_cmp);
        }
        let Some(&budget) = won.get(won.len() / 2) else {
            let [from, to] = [knots[0], knots[knots.len() - 1]].map(seconds);
            let when = if from == to { format!("{from},") } else { format!("{from} to {to},") };
            return format!(
                "On this scene, pick plain sampling: for budgets of {when} no other method's {} is \
                 lower by more than 1 % at equal time.",
                self.metric.name()
            );
        };
        let (method, error, plain) = self.winner(budget).expect("it was chosen for that");
        format!(
            "For a budget of {} on this scene, pick '{}': its {} is {}, {} of the plain \
             estimate's at equal time{}; {}.",
            seconds(budget),
            method.method,
            self.metric.name(),
            number(error, 2),
            number(error / plain, 2),
            self.doubt(method, budget),
            self.end()
        )
    }

    /// A remark if the difference may be chance.
    fn doubt(&self, method: &Curve, budget: f64) -> &'static str {
        match method.interval_at(budget).zip(self.plain.interval_at(budget)) {
            Some((method, plain)) if method[1] >= plain[0] => " (their 95 % intervals overlap)",
            Some(_) => "",
            None => " (by a single run)",
        }
    }

    /// From where on plain sampling wins; there must be a method that wins somewhere.
    fn end(&self) -> String {
        let ends = self.others.iter().filter_map(|it| Some((*it, self.last_win(it)?)));
        let (method, (time, crossed)) = ends
            .max_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
            .expect("a method wins");
        if crossed {
            format!("from {} on, plain sampling wins", seconds(time))
        } else {
            format!(
                "at {}, the longest time compared, '{}' is still ahead of plain sampling",
                seconds(time),
                method.method
            )
        }
    }

    /// The last time at which a method wins, and whether it loses after it; `None` if it never
    /// wins.
    fn last_win(&self, method: &'a Curve) -> Option<(f64, bool)> {
        let duel = self.alone(method);
        let knots = duel.knots();
        // Below 0 where the method wins.
        let gap = |time: f64| {
            duel.best_other(time).map(|(_, error, plain)| (error / (WINS * plain)).ln())
        };
        let last = knots.iter().rposition(|&time| gap(time).is_some_and(|gap| gap < 0.0))?;
        let Some(&next) = knots.get(last + 1) else { return Some((knots[last], false)) };
        let (won, lost) = (gap(knots[last])?, gap(next)?);
        let share = won / (won - lost);
        Some((knots[last] * (next / knots[last]).powf(share), true))
    }

    /// For methods that no time was measured of which both have an error.
    fn same_count(&self) -> String {
        let pairs = self.others.iter().flat_map(|other| {
            let useful = |curve: &'a Curve| curve.points.iter().filter(|it| curve.is_useful(it));
            let plain = move |spp| useful(self.plain).find(|plain| plain.spp == spp);
            useful(other).filter_map(move |point| {
                let (place, plain) = (point.place()?, plain(point.spp)?.place()?);
                Some((other, point.spp, place, plain))
            })
        });
        let metric = self.metric.name();
        let more = "measure more sample counts to compare at equal time";
        let best = pairs.min_by(|a, b| (a.2.1 / a.3.1).total_cmp(&(b.2.1 / b.3.1)));
        match best {
            Some((other, spp, place, plain)) if place.1 < WINS * plain.1 => format!(
                "At {spp} spp '{}' has the lowest {metric}, {} of the plain estimate's, in {} times \
                 its time; {more}.",
                other.method,
                number(place.1 / plain.1, 2),
                number(place.0 / plain.0, 2)
            ),
            Some((_, spp, ..)) => {
                format!(
                    "At {spp} spp no method's {metric} is lower than the plain estimate's by more \
                     than 1 %; {more}."
                )
            }
            None => format!("No time was measured both of '{PLAIN}' and another method; {more}."),
        }
    }
}

#[cfg(test)]
mod tests;
