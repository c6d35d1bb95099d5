use super::*;
use crate::results::Row;

/// A method: its name; samples per pixel, seconds and MSE of its points.
type Points<'a> = (&'a str, &'a [(u32, f64, f64)]);

/// A table of methods by their points.
fn table(methods: &[Points]) -> Results {
    let rows = methods.iter().flat_map(|(method, points)| {
        points.iter().map(|&(spp, seconds, mse)| Row {
            method: (*method).to_owned(),
            spp,
            mse: Some(mse),
            total_seconds: Some(seconds),
            ..Row::default()
        })
    });
    Results::of(rows).expect("rows that fit together")
}

/// MSE 1 / t from 1 to 100 s.
const PLAIN_POINTS: Points = ("none", &[(8, 1.0, 1.0), (80, 10.0, 0.1), (800, 100.0, 0.01)]);

fn says(methods: &[Points], expected: &str) {
    assert_eq!(advice(&table(methods), Metric::Mse), expected);
}

#[test]
fn a_method_that_plain_sampling_overtakes() {
    // Its logarithm falls by 1 and then by 0 over a decade each: it crosses the plain
    // estimate's, which falls by 1 in each, half of a decade after 10 s.
    let biased =
        [(8, 1.0, 0.316_227_766), (80, 10.0, 0.031_622_776_6), (800, 100.0, 0.031_622_776_6)];
    says(
        &[PLAIN_POINTS, ("biased", &biased)],
        "For a budget of 5 s on this scene, pick 'biased': its MSE is 0.063, 0.32 of the plain \
         estimate's at equal time (by a single run); from 31 s on, plain sampling wins.",
    );
    // Another one that ends earlier, behind: no change. One that leads then: it is named.
    let behind = [(8, 1.0, 2.0), (80, 10.0, 1.0)];
    let found = advice(&table(&[PLAIN_POINTS, ("biased", &biased), ("b", &behind)]), Metric::Mse);
    assert!(found.contains("pick 'biased'") && found.contains("from 31 s on, plain"), "{found}");
    let ahead = [(80, 9.0, 0.05), (800, 90.0, 0.005)];
    let found = advice(&table(&[PLAIN_POINTS, ("biased", &biased), ("b", &ahead)]), Metric::Mse);
    assert!(found.contains("at 90 s, the longest time compared, 'b' is still ahead"), "{found}");
}

#[test]
fn a_method_that_stays_ahead() {
    let half = [(8, 1.1, 0.45), (80, 10.1, 0.045), (800, 100.1, 0.0045)];
    says(
        &[("half", &half), PLAIN_POINTS],
        "For a budget of 20 s on this scene, pick 'half': its MSE is 0.023, 0.45 of the plain \
         estimate's at equal time (by a single run); at 100 s, the longest time compared, 'half' is \
         still ahead of plain sampling.",
    );
}

#[test]
fn chance() {
    let says = |errors: [f64; 2], remark: &str| {
        let rows =
            [("none", [1.0, 1.01]), ("a", errors)].into_iter().flat_map(|(method, errors)| {
                [8, 80].into_iter().flat_map(move |spp| {
                    errors.into_iter().zip(0..).map(move |(error, run)| Row {
                        method: method.to_owned(),
                        spp,
                        run,
                        mse: Some(error * 8.0 / f64::from(spp)),
                        total_seconds: Some(f64::from(spp)),
                        ..Row::default()
                    })
                })
            });
        let found = advice(&Results::of(rows).expect("rows that fit together"), Metric::Mse);
        assert!(found.contains(&format!("at equal time{remark}; at")), "{found}");
    };
    says([0.5, 0.51], "");
    says([0.5, 0.99], " (their 95 % intervals overlap)");
}

#[test]
fn plain_sampling_is_best() {
    let slow = [(8, 2.0, 0.9), (80, 20.0, 0.09), (800, 200.0, 0.009)];
    says(
        &[PLAIN_POINTS, ("slow", &slow)],
        "On this scene, pick plain sampling: for budgets of 2 s to 100 s, no other method's MSE is \
         lower by more than 1 % at equal time.",
    );
    // The same error in the same time is no gain.
    let found = advice(&table(&[PLAIN_POINTS, ("same", PLAIN_POINTS.1)]), Metric::Mse);
    assert!(found.contains("pick plain sampling"), "{found}");
}

#[test]
fn one_sample_count() {
    says(
        &[("none", &[(8, 1.0, 1.0)]), ("a", &[(8, 1.5, 0.5)]), ("b", &[(8, 1.1, 0.75)])],
        "At 8 spp 'a' has the lowest MSE, 0.5 of the plain estimate's, in 1.5 times its time; \
         measure more sample counts to compare at equal time.",
    );
    says(
        &[("none", &[(8, 1.0, 1.0)]), ("a", &[(8, 1.5, 1.5)])],
        "At 8 spp no method's MSE is lower than the plain estimate's by more than 1 %; measure more \
         sample counts to compare at equal time.",
    );
    says(
        &[("none", &[(8, 1.0, 1.0)]), ("a", &[(16, 2.0, 1.5)])],
        "No time was measured both of 'none' and another method; measure more sample counts to \
         compare at equal time.",
    );
}

/// A gain of less than 1 % is none, at equal time and at equal samples.
#[test]
fn gains_that_are_too_small() {
    let points = |factor: f64| PLAIN_POINTS.1.iter().map(move |it| (it.0, it.1, factor * it.2));
    let found = |factor: f64| {
        let close: Vec<_> = points(factor).collect();
        advice(&table(&[PLAIN_POINTS, ("close", &close)]), Metric::Mse)
    };
    assert!(found(0.992).contains("pick plain sampling"), "{}", found(0.992));
    assert!(found(0.985).contains("pick 'close'"), "{}", found(0.985));
    let one = |mse: f64| {
        advice(&table(&[("none", &[(8, 1.0, 1.0)]), ("a", &[(8, 1.5, mse)])]), Metric::Mse)
    };
    assert!(one(0.992).starts_with("At 8 spp no method's MSE is lower"), "{}", one(0.992));
    assert!(one(0.985).starts_with("At 8 spp 'a' has the lowest MSE"), "{}", one(0.985));
}

/// A point that is slower and worse than another of its method is none to choose.
#[test]
fn cold_starts_are_not_chosen() {
    // At 8 spp, 'a' has the lowest share of the plain estimate's error, but took longer than at
    // 16 spp for a larger error.
    let a = ("a", &[(8, 4.0, 0.5), (16, 3.0, 0.4)][..]);
    says(
        &[("none", &[(8, 1.0, 2.0), (16, 2.0, 1.0)]), a],
        "At 16 spp 'a' has the lowest MSE, 0.4 of the plain estimate's, in 1.5 times its time; \
         measure more sample counts to compare at equal time.",
    );
}

#[test]
fn nothing_to_compare() {
    says(&[PLAIN_POINTS], "Only plain sampling was measured; there is nothing to choose.");
    says(
        &[("a", PLAIN_POINTS.1)],
        "Plain sampling was not measured; nothing can be compared with it.",
    );
    let all_failed = |failure: Option<&str>| {
        let failure = failure.map(str::to_owned);
        let row = Row { method: "oidn".into(), failure, ..Row::default() };
        advice(&Results::of([row]).expect("a row"), Metric::Mse)
    };
    assert_eq!(
        all_failed(Some("its picture is missing.")),
        "No MSE was measured; 'oidn' failed: its picture is missing."
    );
    assert_eq!(all_failed(None), "No MSE was measured.");
    // Zero by chance.
    says(
        &[("none", &[(8, 1.0, 0.0)])],
        "Nothing can be compared: no MSE above 0 was measured; a reference of more samples per \
         pixel (--reference-spp), or more runs, would show it.",
    );
    let time = "no time is known, only errors; files of other programs say it by the attribute \
                renderTimeSeconds.";
    says(&[("none", &[(8, 0.0, 1.0)])], &format!("Nothing can be compared: {time}"));
    says(
        &[("none", &[(8, 0.0, 1.0)]), ("a", PLAIN_POINTS.1)],
        &format!("Of plain sampling, {time}"),
    );
    says(
        &[PLAIN_POINTS, ("a", &[(8, 0.0, 1.0)])],
        &format!("Of all methods but plain sampling, {time}"),
    );
}

#[test]
fn differences_that_may_be_chance() {
    let rows = |mse: f64, method: &str, run: u32| {
        [(8, 1.0, 1.0), (800, 100.0, 0.01)].map(|(spp, seconds, error)| Row {
            method: method.to_owned(),
            spp,
            run,
            mse: Some(error * mse),
            total_seconds: Some(seconds),
            ..Row::default()
        })
    };
    let sentence = |factor: f64| {
        let runs = [1.0, 1.1, 1.2].into_iter().zip(0..);
        let all = runs.flat_map(|(mse, run)| {
            [rows(mse, "none", run), rows(factor * mse, "a", run)].into_iter().flatten()
        });
        advice(&Results::of(all).expect("rows that fit together"), Metric::Mse)
    };
    assert!(sentence(0.9).contains("equal time (their 95 % intervals overlap);"));
    assert!(sentence(0.2).contains("equal time;"));
}

/// The only gain is where no round budget is.
#[test]
fn a_gain_at_one_time() {
    let found = advice(
        &table(&[PLAIN_POINTS, ("a", &[(8, 5.5, 2.0), (80, 6.0, 0.1), (800, 60.0, 0.1)])]),
        Metric::Mse,
    );
    assert!(found.contains("For a budget of 6 s") && found.contains("pick 'a'"), "{found}");
    // 1 % before plain sampling is as good.
    assert!(found.ends_with("from 9.9 s on, plain sampling wins."), "{found}");
    // Its share of the plain estimate's error is 0.935 at 5.5 s, and 1.014 at 6 s: 0.99 is at 70 %
    // of the way between their logarithms.
    let ends = ("a", &[(8, 5.5, 0.17), (80, 6.0, 0.169), (800, 60.0, 0.169)][..]);
    let found = advice(&table(&[PLAIN_POINTS, ends]), Metric::Mse);
    assert!(found.contains("For a budget of 5.5 s") && found.contains("pick 'a'"), "{found}");
    assert!(found.ends_with("from 5.8 s on, plain sampling wins."), "{found}");
}

#[test]
fn budgets_are_round() {
    let found = |methods: &[Points]| budgets(&table(methods).curves(Metric::Mse));
    let a = ("a", &[(8, 1.5, 1.0), (80, 11.0, 0.1)][..]);
    assert_eq!(found(&[PLAIN_POINTS, a]), [2.0, 5.0, 10.0]);
    let narrow = ("a", &[(8, 11.0, 1.0), (80, 12.0, 0.1)][..]);
    assert_eq!(found(&[PLAIN_POINTS, narrow]), [11.0, 12.0]);
    assert!(found(&[PLAIN_POINTS]).is_empty());
    assert!(found(&[a]).is_empty());
}
