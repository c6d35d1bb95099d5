//! Errors against time: the Pareto front, and methods at equal time.

use std::cmp::Ordering;

use super::{metric::Metric, row::PLAIN, summary::Summary};

/// A method at one sample count.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Point {
    /// Samples per pixel.
    pub(crate) spp: u32,
    /// Seconds of the whole job: the median over the runs; `None` if they are not known.
    pub(crate) seconds: Option<f64>,
    /// The mean error over the runs; 0 and less by chance, where it is too small to be measured.
    pub(crate) error: f64,
    /// The 95 % interval of the error, for more than one run.
    pub(crate) interval: Option<[f64; 2]>,
    /// Whether no point of any method is as good in time and error, and better in one of them.
    pub(crate) on_front: bool,
}

impl Point {
    /// Seconds and error, if both are above 0.
    pub(crate) fn place(&self) -> Option<(f64, f64)> {
        let seconds = self.seconds?;
        (seconds > 0.0 && self.error > 0.0).then_some((seconds, self.error))
    }
}

/// A method at all sample counts at which it was measured.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Curve {
    pub(crate) method: String,
    /// At least one; from the fewest samples per pixel.
    pub(crate) points: Vec<Point>,
    /// Seconds and the best point that they buy, from the fastest: a budget may always be spent
    /// on a better point that takes less. The last may have the point before it again.
    placed: Vec<(f64, Point)>,
    /// Where the error is known beyond the points, as it is in inverse proportion to the
    /// samples: the seconds of the last point that do not depend on them.
    overhead: Option<f64>,
}

/// All methods that were measured, in the order of the table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Curves {
    pub(crate) metric: Metric,
    pub(crate) curves: Vec<Curve>,
}

impl Curves {
    pub(super) fn of(summaries: &[Summary], metric: Metric) -> Self {
        let mut methods: Vec<(&str, Vec<Point>)> = Vec::new();
        for summary in summaries {
            let Some(error) = summary.error(metric) else { continue };
            let point = Point {
                spp: summary.spp,
                seconds: summary.seconds.total,
                error: error.mean,
                interval: error.interval,
                on_front: false,
            };
            match methods.last_mut().filter(|(method, _)| *method == summary.method) {
                Some((_, points)) => points.push(point),
                None => methods.push((&summary.method, vec![point])),
            }
        }
        let all = methods.iter_mut().flat_map(|(_, points)| points);
        let mut placed: Vec<&mut Point> = all.filter(|point| point.place().is_some()).collect();
        let places: Vec<_> = placed.iter().filter_map(|point| point.place()).collect();
        for i in front(&places) {
            placed[i].on_front = true;
        }
        let curve = |(method, points): (&str, Vec<Point>)| {
            Curve::new(method, points, |spp| overhead(summaries, method, spp, metric))
        };
        Self { metric, curves: methods.into_iter().map(curve).collect() }
    }

    /// The plain estimate, if it was measured.
    pub(crate) fn plain(&self) -> Option<&Curve> {
        self.curves.iter().find(|curve| curve.method == PLAIN)
    }

    /// All other methods.
    pub(crate) fn others(&self) -> impl Iterator<Item = &Curve> {
        self.curves.iter().filter(|curve| curve.method != PLAIN)
    }
}

impl Curve {
    /// A curve of these points; `overhead` gives that of the point of a sample count.
    fn new(method: &str, points: Vec<Point>, overhead: impl Fn(u32) -> Option<f64>) -> Self {
        let mut all: Vec<(f64, f64, Point)> = points
            .iter()
            .filter_map(|point| point.place().map(|(seconds, error)| (seconds, error, *point)))
            .collect();
        all.sort_by(|a, b| order((a.0, a.1), (b.0, b.1)));
        let longest = all.last().map(|last| last.0);
        let mut placed: Vec<(f64, Point)> = Vec::new();
        for (seconds, error, point) in all {
            if placed.last().is_none_or(|(_, best)| error < best.error) {
                placed.push((seconds, point));
            }
        }
        let overhead = placed.last().and_then(|(_, last)| overhead(last.spp));
        if let (Some(longest), Some(&(last, best)), None) = (longest, placed.last(), overhead)
            && longest > last
        {
            placed.push((longest, best));
        }
        Self { method: method.to_owned(), points, placed, overhead }
    }

    /// Whether no other point of this method is at least as fast and as good.
    pub(super) fn is_useful(&self, point: &Point) -> bool {
        self.placed.iter().any(|(_, useful)| useful == point)
    }

    /// The measured times that buy a better error than shorter ones, and the longest of all.
    pub(crate) fn times(&self) -> impl Iterator<Item = f64> {
        self.placed.iter().map(|(seconds, _)| *seconds)
    }

    /// The shortest and the longest of [`Self::times`].
    pub(super) fn span(&self) -> Option<[f64; 2]> {
        Some([self.placed.first()?.0, self.placed.last()?.0])
    }

    /// The error for a budget of time: linear in the logarithms between measured points. Beyond
    /// them it is `None`, but for plain sampling, whose squared error is in inverse proportion
    /// to the samples: more time than was measured buys more of them.
    pub(crate) fn error_at(&self, seconds: f64) -> Option<f64> {
        self.at(seconds, |point| Some(point.error))
    }

    /// The ends of the 95 % interval for a budget of time, as [`Self::error_at`].
    pub(crate) fn interval_at(&self, seconds: f64) -> Option<[f64; 2]> {
        // The interval of a small error may reach below 0, which has no logarithm.
        let end =
            |i: usize| self.at(seconds, |point| Some(point.interval?[i].max(f64::MIN_POSITIVE)));
        Some([end(0)?, end(1)?])
    }

    fn at(&self, seconds: f64, value: impl Fn(&Point) -> Option<f64>) -> Option<f64> {
        if seconds.is_nan() {
            return None;
        }
        let after = self.placed.partition_point(|(time, _)| *time < seconds);
        let Some((late_time, late)) = self.placed.get(after) else {
            let ((last_time, last), overhead) = (self.placed.last()?, self.overhead?);
            return Some(value(last)? * ((last_time - overhead) / (seconds - overhead)));
        };
        if *late_time == seconds {
            return value(late);
        }
        let (early_time, early) = self.placed.get(after.checked_sub(1)?)?;
        let (early, late) = (value(early)?, value(late)?);
        let share = (seconds / early_time).ln() / (late_time / early_time).ln();
        Some(early * (late / early).powf(share))
    }
}

/// The seconds of plain sampling with this many samples that do not depend on them, if both are
/// known; `None` for other methods, and for metrics that are no squares.
fn overhead(summaries: &[Summary], method: &str, spp: u32, metric: Metric) -> Option<f64> {
    let squared = method == PLAIN && metric != Metric::Smape;
    let it = summaries.iter().find(|it| squared && it.method == PLAIN && it.spp == spp)?;
    let (total, render) = (it.seconds.total?, it.seconds.render?);
    (render > 0.0 && render <= total).then_some(total - render)
}

/// From the fastest, and then from the smallest error.
fn order(a: (f64, f64), b: (f64, f64)) -> Ordering {
    a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
}

/// Which of the points (time, error) no other one dominates: none is at most as large in both,
/// and smaller in one. All numbers must be finite.
pub(crate) fn front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut sorted: Vec<usize> = (0..points.len()).collect();
    sorted.sort_by(|&a, &b| order(points[a], points[b]));
    let mut front: Vec<usize> = Vec::new();
    for i in sorted {
        let last = front.last().map(|&last| points[last]);
        // Equal points do not dominate each other.
        if last.is_none_or(|last| points[i].1 < last.1 || points[i] == last) {
            front.push(i);
        }
    }
    front
}

#[cfg(test)]
mod tests {
    use proptest::{prelude::*, test_runner::RngSeed};

    use super::*;
    use crate::results::Row;

    fn curve(places: &[(f64, f64)]) -> Curve {
        let point = |(i, &(seconds, error)): (usize, &(f64, f64))| Point {
            spp: 1 << i,
            seconds: Some(seconds),
            error,
            interval: None,
            on_front: false,
        };
        Curve::new("m", places.iter().enumerate().map(point).collect(), |_| None)
    }

    #[test]
    fn errors_at_equal_time_by_hand() {
        // The error falls as t⁻², then as t⁻¹; the order of the points does not matter.
        let curve = curve(&[(4.0, 1.0), (1.0, 16.0), (16.0, 0.25), (9.0, -1.0)]);
        for (seconds, expected) in [(1.0, 16.0), (2.0, 4.0), (4.0, 1.0), (8.0, 0.5), (16.0, 0.25)] {
            let error = curve.error_at(seconds).expect("between measured points");
            assert!((error - expected).abs() < 1e-12, "{seconds}: {error}");
        }
        assert!(curve.error_at(2.1).is_some_and(|error| (error - 4.0).abs() > 0.1));
        for beyond in [0.99, 16.01, 0.0, f64::NAN] {
            assert_eq!(curve.error_at(beyond), None, "{beyond}");
        }
        assert!(curve.times().eq([1.0, 4.0, 16.0]));
    }

    /// The first point is a cold start: slower and worse than the second.
    #[test]
    fn a_budget_is_spent_on_the_better_point() {
        let cold = curve(&[(8.0, 2.0), (1.0, 1.0), (2.0, 0.5), (9.0, 0.6)]);
        for (seconds, expected) in [(1.0, 1.0), (2.0, 0.5), (5.0, 0.5), (8.0, 0.5), (9.0, 0.5)] {
            assert_eq!(cold.error_at(seconds), Some(expected), "{seconds}");
        }
        assert_eq!([cold.error_at(0.9), cold.error_at(9.1)], [None, None]);
        assert_eq!(cold.span(), Some([1.0, 9.0]));
        let useful = cold.points.iter().map(|point| cold.is_useful(point));
        assert!(useful.eq([false, true, true, false]));
        // Plain sampling goes on from the better point, not from the slow one.
        let warm = Curve::new("m", cold.points, |spp| (spp == 4).then_some(0.0));
        assert_eq!([warm.error_at(4.0), warm.error_at(20.0)], [Some(0.25), Some(0.05)]);
    }

    #[test]
    fn points_that_take_the_same_time() {
        let twice = curve(&[(1.0, 3.0), (1.0, 2.0), (4.0, 1.0)]);
        assert_eq!((twice.error_at(1.0), twice.times().count()), (Some(2.0), 2));
        assert_eq!(curve(&[(1.0, 3.0)]).error_at(1.0), Some(3.0));
        assert_eq!(curve(&[(1.0, -3.0)]).times().count(), 0);
    }

    #[test]
    fn intervals_at_equal_time() {
        let mut points = curve(&[(1.0, 4.0), (4.0, 1.0)]).points;
        assert_eq!(Curve::new("m", points.clone(), |_| None).interval_at(2.0), None);
        points[0].interval = Some([-1.0, 16.0]);
        points[1].interval = Some([0.5, 4.0]);
        let curve = Curve::new("m", points, |_| None);
        let [low, high] = curve.interval_at(2.0).expect("between measured points");
        assert!(low > 0.0 && low < 1e-100 && (high - 8.0).abs() < 1e-12, "{low} {high}");
    }

    #[test]
    fn plain_sampling_goes_on_as_one_over_n() {
        let row = |method: &str, total| Row {
            method: method.into(),
            spp: 8,
            mse: Some(4.0),
            smape: Some(4.0),
            render_seconds: Some(total - 1.0),
            total_seconds: Some(total),
            ..Row::default()
        };
        let summaries = Summary::all(&[row("none", 3.0), row("other", 3.0)]);
        let curves = Curves::of(&summaries, Metric::Mse);
        let plain = curves.plain().expect("it is there");
        // Two seconds of samples become eight, beside one that stays.
        assert_eq!([plain.error_at(3.0), plain.error_at(9.0)], [Some(4.0), Some(1.0)]);
        assert_eq!([plain.error_at(2.9), plain.error_at(f64::NAN)], [None, None]);
        assert_eq!(curves.curves[1].error_at(9.0), None, "it may be biased");
        let smape = Curves::of(&summaries, Metric::Smape);
        assert_eq!(smape.curves[0].error_at(9.0), None, "it is no square");
    }

    #[test]
    fn curves_of_a_table() {
        let row = |method: &str, spp, mse, total_seconds| Row {
            method: method.into(),
            spp,
            mse,
            total_seconds,
            ..Row::default()
        };
        let rows = [
            row("none", 8, Some(4.0), Some(1.0)),
            row("none", 16, Some(2.0), Some(2.0)),
            row("a", 8, Some(2.0), Some(1.5)),
            row("a", 16, None, None),
            row("b", 8, None, Some(1.0)),
            row("c", 8, Some(-1e-9), Some(0.1)),
            row("d", 8, Some(1e-9), None),
        ];
        let curves = Curves::of(&Summary::all(&rows), Metric::Mse);
        let names: Vec<_> = curves.curves.iter().map(|curve| &*curve.method).collect();
        assert_eq!(names, ["none", "a", "c", "d"]);
        let front = curves.curves.iter().flat_map(|curve| &curve.points);
        let front: Vec<bool> = front.map(|point| point.on_front).collect();
        assert_eq!(front, [true, false, true, false, false]);
        assert_eq!(curves.others().count(), 3);
        assert!(Curves::of(&Summary::all(&rows), Metric::Smape).plain().is_none());
    }

    fn dominates(a: (f64, f64), b: (f64, f64)) -> bool {
        a.0 <= b.0 && a.1 <= b.1 && a != b
    }

    /// Whether nothing dominates the front, and something on it dominates all others.
    fn is_front(points: &[(f64, f64)], front: &[usize]) -> bool {
        (0..points.len()).all(|i| {
            let by_any = points.iter().any(|&other| dominates(other, points[i]));
            let by_front = front.iter().any(|&j| dominates(points[j], points[i]));
            if front.contains(&i) { !by_any } else { by_front }
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            failure_persistence: None,
            rng_seed: RngSeed::Fixed(1),
            ..ProptestConfig::default()
        })]
        #[test]
        fn the_front_is_what_nothing_dominates(
            // Few values, so that many are equal.
            points in prop::collection::vec((1_u8..8, 1_u8..8), 0..24)
        ) {
            let points: Vec<_> =
                points.iter().map(|&(x, y)| (f64::from(x), f64::from(y))).collect();
            let mut found = front(&points);
            prop_assert!(is_front(&points, &found));
            // The check sees a point too few, and one too many.
            let rest = (0..points.len()).find(|i| !found.contains(i));
            if let Some(extra) = rest {
                prop_assert!(!is_front(&points, &[&found[..], &[extra]].concat()));
            }
            if found.pop().is_some() {
                prop_assert!(!is_front(&points, &found));
            }
        }
    }
}
