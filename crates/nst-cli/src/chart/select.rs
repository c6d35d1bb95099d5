//! Which methods are named and in colour, where there are many.

use std::collections::BTreeMap;

use super::palette::{NAMED, Style};
use crate::results::{Curve, Curves, PLAIN, budgets};

/// The method that chooses by itself.
const AUTO: &str = "auto";

/// The styles of methods by their names.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Styles {
    styles: BTreeMap<String, Style>,
}

impl Styles {
    /// Names `auto`, which users get who choose nothing, those on the Pareto front, and then those that are best at equal time; all, if
    /// there are few. The order of the table decides who gets which style.
    pub(super) fn choose(all: &[Curves]) -> Self {
        let mut methods: Vec<&str> = Vec::new();
        let mut scores: BTreeMap<&str, (usize, f64)> = BTreeMap::new();
        for curves in all {
            let budgets = budgets(curves);
            for curve in curves.others() {
                let score = scores.entry(&curve.method).or_insert_with(|| {
                    methods.push(&curve.method);
                    (0, f64::INFINITY)
                });
                score.0 += curve.points.iter().filter(|point| point.on_front).count();
                score.1 = score.1.min(best_ratio(curves, curve, &budgets));
            }
        }
        let mut ranked = methods.clone();
        ranked.sort_by(|&a, &b| {
            let own = (b == AUTO).cmp(&(a == AUTO));
            let (a, b) = (scores[a], scores[b]);
            own.then(b.0.cmp(&a.0)).then(a.1.total_cmp(&b.1))
        });
        ranked.truncate(NAMED);
        let named = methods.iter().filter(|method| ranked.contains(method)).enumerate();
        let mut styles: BTreeMap<String, Style> =
            named.map(|(place, method)| ((*method).to_owned(), Style::named(place))).collect();
        styles.insert(PLAIN.to_owned(), Style::PLAIN);
        Self { styles }
    }

    pub(super) fn of(&self, method: &str) -> Style {
        self.styles.get(method).copied().unwrap_or(Style::MUTED)
    }
}

/// The least error relative to the plain estimate's, at equal time or, where none is known, at
/// equal samples.
fn best_ratio(curves: &Curves, curve: &Curve, budgets: &[f64]) -> f64 {
    let Some(plain) = curves.plain() else { return f64::INFINITY };
    let at_time = budgets.iter().filter_map(|&t| Some(curve.error_at(t)? / plain.error_at(t)?));
    let best = at_time.fold(f64::INFINITY, f64::min);
    if best.is_finite() {
        return best;
    }
    let at_count = curve.points.iter().filter_map(|point| {
        let index = plain.points.binary_search_by_key(&point.spp, |plain| plain.spp).ok()?;
        let plain = plain.points[index].error;
        (point.error > 0.0 && plain > 0.0).then(|| point.error / plain)
    });
    at_count.fold(f64::INFINITY, f64::min)
}

/// What charts call a method.
pub(super) fn display_name(method: &str) -> String {
    if method == PLAIN { "plain sampling".to_owned() } else { method.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::{Metric, Results, Row};

    /// Of methods by name, seconds and MSE, each at one sample count; `none` at two.
    fn chosen(methods: &[(&str, f64, f64)]) -> Vec<String> {
        let row = |(method, seconds, mse): (&str, f64, f64), spp| Row {
            method: method.to_owned(),
            spp,
            mse: Some(mse),
            total_seconds: Some(seconds),
            ..Row::default()
        };
        let plain = [row((PLAIN, 1.0, 1.0), 8), row((PLAIN, 100.0, 0.01), 800)];
        let all = plain.into_iter().chain(methods.iter().map(|&method| row(method, 8)));
        let results = Results::of(all).expect("rows that fit together");
        let styles = Styles::choose(&[results.curves(Metric::Mse)]);
        assert_eq!(styles.of(PLAIN), Style::PLAIN);
        let named = methods.iter().map(|method| method.0);
        named.filter(|name| !styles.of(name).is_muted()).map(str::to_owned).collect()
    }

    #[test]
    fn few_are_all_named() {
        let six = [("a", 1.0, 9.0), ("b", 1.0, 8.0), ("c", 1.0, 7.0), ("d", 0.1, 2.0)];
        assert_eq!(chosen(&six), ["a", "b", "c", "d"]);
    }

    #[test]
    fn of_many_the_front_and_the_best_are_named() {
        let many = [
            ("bad", 10.0, 9.0),
            ("front", 1.0, 0.1),
            ("worse", 10.0, 10.0),
            ("c", 10.0, 0.5),
            ("d", 10.0, 0.4),
            ("e", 10.0, 0.3),
            ("f", 10.0, 0.2),
            ("g", 10.0, 0.6),
        ];
        assert_eq!(chosen(&many), ["front", "c", "d", "e", "f", "g"]);
        let mut with_auto = many;
        with_auto[2].0 = "auto";
        assert_eq!(chosen(&with_auto), ["front", "auto", "c", "d", "e", "f"]);
    }
}
