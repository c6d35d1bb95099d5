//! The kinds of sequences that methods are tested on: what they are, and why methods fail
//! on them.

use std::f64::consts::{E, LN_2, PI};

use nst_core::{Side, random::SplitMix64};

use super::{
    integrands::{COUNT, Family, Integrand},
    simulate::{Case, Runs, series, simulate},
};

/// A kind of sequences.
pub(super) struct Regime {
    pub(super) name: &'static str,
    /// What the sequences are.
    pub(super) what: &'static str,
    /// Why methods fail on them.
    pub(super) why: &'static str,
    /// The sequences with n samples, for a number of runs of each integrand.
    pub(super) make: fn(n: u32, runs: Runs) -> Case,
    /// Whether the suite has a row for a million samples, too.
    pub(super) far: bool,
}

/// All regimes, in the order of the tables.
pub(super) const REGIMES: &[Regime] = &[
    Regime {
        name: "linear",
        what: "Partial sums of Σ 0.9^k = 10.",
        why: "Aitken's Δ², θ and ε are exact here. Richardson and a_n g_n expect powers of 1/n, Euler \
              alternating signs; Levin's u divides differences that f32 has rounded, and has lost \
              its digits at n = 64.",
        make: |n, _| SERIES[0].at(&window(n)).0,
        far: false,
    },
    Regime {
        name: "alternating",
        what: "Partial sums of 1 − 1/2 + 1/3 − … = ln 2.",
        why: "Methods that average neighbours gain, until f32 has no further digits. \
              Richardson and \
              a_n g_n take the sign of the last step for a trend; the bound on the distance from S \
              catches the former.",
        make: |n, _| SERIES[1].at(&window(n)).0,
        far: false,
    },
    Regime {
        name: "logarithmic",
        what: "Partial sums of 1 + 1/4 + 1/9 + … = π²/6.",
        why: "In f64, Levin, θ and Richardson gain five to eight digits; in f32 the steps 1/n² are soon \
              a few units in the last place, and rounding is all there is to extrapolate. a_n g_n, \
              which reads one step only, works longest.",
        make: |n, _| SERIES[2].at(&window(n)).0,
        far: false,
    },
    Regime {
        name: "hyperlinear",
        what: "Partial sums of 1 + 1 + 1/2 + 1/6 + … = e.",
        why: "S_16 is exact in f32: nothing is left to gain. Before that, methods that are meant for \
              slower sequences overshoot.",
        make: |n, _| SERIES[3].at(&window(n)).0,
        far: false,
    },
    Regime {
        name: "gaussian",
        what: "The paper's Gaussians on [0, 1]: nine integrands.",
        why: "A step of a running mean is fresh noise, σ/n beside an error of σ/√n: classical methods \
              take it for a trend and divide by differences that may be near 0, so that none gains \
              at any n. Networks trained on n ≤ 64 have an error that does not fall with n, and \
              spoil what 4096 or a million samples have reached.",
        make: |n, runs| family(Family::Gaussian, &window(n), runs, |y| y),
        far: true,
    },
    Regime {
        name: "step",
        what: "The paper's step functions: nine integrands.",
        why: "As before. Runs of equal samples look geometric to Aitken's Δ², which then extrapolates \
              far; where a whole window looks so, denominators vanish.",
        make: |n, runs| family(Family::Step, &window(n), runs, |y| y),
        far: true,
    },
    Regime {
        name: "gaussian-step",
        what: "The paper's products of both: nine integrands.",
        why: "As before; where x ≥ t samples are 0, and few samples make folds so unequal that \
              re-weighting darkens them.",
        make: |n, runs| family(Family::GaussianStep, &window(n), runs, |y| y),
        far: true,
    },
    Regime {
        name: "bernoulli",
        what: "Samples are 1 with probability 0.001, else 0.",
        why: "Robust methods take the rare 1 for an outlier. The MSE falls, as to forget a rare event \
              costs less than its noise, but what is left is bias; from n = 1024 on, where \
              a fold has a 1 or none, they are worse than S.",
        make: |n, runs| {
            simulate(&window(n), runs.lanes(), runs.seed(2), |_, _| {
                (1e-3, |_: u32, rng: &mut SplitMix64| f64::from(u8::from(rng.uniform() < 1e-3)))
            })
        },
        far: false,
    },
    Regime {
        name: "pareto",
        what: "Pareto samples with index 1.5: the mean is 3, the variance infinite.",
        why: "No ratio of squared errors has an expectation here: a few lanes decide, and other seeds \
              give other numbers. Methods that ignore the largest samples seem to gain, by a bias that \
              more samples do not remove quickly.",
        make: |n, runs| {
            simulate(&window(n), runs.lanes(), runs.seed(3), |_, _| {
                (3.0, |_: u32, rng: &mut SplitMix64| (1.0 - rng.uniform()).powf(-1.0 / 1.5))
            })
        },
        far: false,
    },
    Regime {
        name: "scale-1e6",
        what: "The Gaussians times 10⁶.",
        why: "Classical and robust methods scale with their input. Networks have learned the scale of \
              what they were trained on.",
        make: |n, runs| family(Family::Gaussian, &window(n), runs, |y| 1e6 * y),
        far: false,
    },
    Regime {
        name: "scale-1e-6",
        what: "The Gaussians times 10⁻⁶.",
        why: "The same, worse: a network's answer has the size of its training data for any input.",
        make: |n, runs| family(Family::Gaussian, &window(n), runs, |y| 1e-6 * y),
        far: false,
    },
    Regime {
        name: "mixed-scales",
        what: "The Gaussians; one lane in three a quarter, one in three four times of what they are.",
        why: "What a lane is worth no longer follows from its size beside the others. Networks take a \
              bright lane for a narrow Gaussian; what is learnt from the batch does not.",
        make: |n, runs| {
            scaled(Family::Gaussian, &window(n), runs, |lane| {
                4.0_f64.powi((lane / COUNT % 3) as i32 - 1)
            })
        },
        far: false,
    },
    Regime {
        name: "quarter",
        what: "The Gaussians, a quarter of what they are.",
        why: "For methods without a unit they are the same as before.",
        make: |n, runs| scaled(Family::Gaussian, &window(n), runs, |_| 0.25),
        far: false,
    },
    Regime {
        name: "four-times",
        what: "The Gaussians, four times of what they are.",
        why: "As before.",
        make: |n, runs| scaled(Family::Gaussian, &window(n), runs, |_| 4.0),
        far: false,
    },
    Regime {
        name: "powers",
        what: "h x^q on [0, 1] with q = 1, 3, 8 and h = 1/2, 1, 2: a family that no network has seen.",
        why: "Networks take them for what they know, and are wrong by as much at any n.",
        make: |n, runs| {
            simulate(&window(n), runs.lanes(), runs.seed(8), |lane, _| {
                let (q, h) = ([1, 3, 8][lane % 3], [0.5, 1.0, 2.0][lane / 3 % 3]);
                let sample = move |_: u32, rng: &mut SplitMix64| h * rng.uniform().powi(q);
                (h / f64::from(q + 1), sample)
            })
        },
        far: false,
    },
    Regime {
        name: "offset-1e4",
        what: "The Gaussians plus 10⁴: in f32, terms are multiples of 0.00098.",
        why: "Differences of terms have lost most of their digits, and windows with equal neighbours \
              are common; networks have never seen such numbers.",
        make: |n, runs| family(Family::Gaussian, &window(n), runs, |y| 1e4 + y),
        far: false,
    },
    Regime {
        name: "constant",
        what: "All samples of a lane are equal; lanes differ.",
        why: "The prior mean replaces lanes that are exact. All others leave them alone.",
        make: |n, runs| {
            simulate(&window(n), runs.lanes(), runs.seed(4), |lane, _| {
                let value = 0.5 + (lane % 16) as f64 / 16.0;
                (value, move |_: u32, _: &mut SplitMix64| value)
            })
        },
        far: false,
    },
    Regime {
        name: "zero",
        what: "All samples are 0.",
        why: "Nothing fails: there is nothing to divide, and no lane is touched.",
        make: |n, runs| {
            simulate(&window(n), runs.lanes(), runs.seed(5), |_, _| {
                (0.0, |_: u32, _: &mut SplitMix64| 0.0)
            })
        },
        far: false,
    },
    Regime {
        name: "firefly-first",
        what: "The Gaussians; the first sample is 1000, and the limit does not include it.",
        why: "All terms of the window contain the outlier, so that no classical method can tell it from \
              signal; a_n g_n returns about the last sample alone, which looks good for that reason \
              only. G-MoN and re-weighting trust the fold again when n is so large that it stands \
              out by less than the factor that they allow; ridge learns the mean of all lanes, \
              which is as wrong.",
        make: |n, runs| firefly(n, runs, 0),
        far: false,
    },
    Regime {
        name: "firefly-middle",
        what: "The same, at the sample n/2.",
        why: "As before: only at n = 8 is the outlier inside of the window.",
        make: |n, runs| firefly(n, runs, n / 2),
        far: false,
    },
    Regime {
        name: "firefly-last",
        what: "The same, at the last sample.",
        why: "Aitken's Δ² and Euler go back to the terms before the jump. a_n g_n takes the jump for \
              the answer.",
        make: |n, runs| firefly(n, runs, n - 1),
        far: false,
    },
    Regime {
        name: "correlated",
        what: "The Gaussians along a Markov chain that stays at its point with probability 0.9.",
        why: "Steps keep their sign for a while, so that extrapolating them harms a little less. Folds \
              share the chain's points and all err alike: their spread says nothing of the error, \
              and methods that read them can neither gain nor harm.",
        make: |n, runs| {
            simulate(&window(n), runs.lanes(), runs.seed(6), |lane, rng| {
                let integrand = Family::Gaussian.integrand(lane % COUNT);
                let mut x = rng.uniform();
                let sample = move |_: u32, rng: &mut SplitMix64| {
                    if rng.uniform() > 0.9 {
                        x = rng.uniform();
                    }
                    integrand.at(x)
                };
                (integrand.integral(), sample)
            })
        },
        far: false,
    },
    Regime {
        name: "halton",
        what: "The Gaussians at the points of the Halton sequence in base 2: one run.",
        why: "S converges nearly as 1/n, and its steps are no noise that could be averaged. Sample i \
              mod 4 fixes the two leading bits of x, so that each fold sees a quarter of the \
              interval: fold means are no estimates of I, and every method that uses them as \
              estimates fails. `auto` knows the sampler, and keeps S. (nst render --sampler \
              halton-folds has independent ones.)",
        make: |n, runs| halton(n, Runs { each: 1, ..runs }, |_| 0),
        far: false,
    },
    Regime {
        name: "halton-random",
        what: "The same, with a random digital shift for each run.",
        why: "As before, for every shift.",
        make: |n, runs| halton(n, runs, |rng| rng.next_u64() as u32),
        far: false,
    },
    Regime {
        name: "gaps",
        what: "The Gaussians; the eight terms are n/8, 2n/8, …, n.",
        why: "Steps are as large as the error, so that noise is extrapolated by a factor that does not \
              grow with n; it is still noise. The networks expect consecutive terms.",
        make: |n, runs| {
            let counts: Vec<_> = (1..=8).map(|k| k * (n / 8)).collect();
            family(Family::Gaussian, &counts, runs, |y| y)
        },
        far: false,
    },
    Regime {
        name: "short",
        what: "The Gaussians; only the last four terms are stored.",
        why: "Methods that read more terms return S and say so.",
        make: |n, runs| family(Family::Gaussian, &window(n)[4..], runs, |y| y),
        far: false,
    },
    Regime {
        name: "nonfinite",
        what: "The Gaussians; one lane in ten has a NaN or an infinity among its terms, \
               another one in ten among its folds.",
        why: "Lanes where a method reads one of these numbers keep S, and say so; the others are as \
              before.",
        make: nonfinite,
        far: false,
    },
];

/// A series whose sum is known.
pub(super) struct Series {
    pub(super) name: &'static str,
    pub(super) limit: f64,
    /// The terms, counted from 1.
    term: fn(u32) -> f64,
}

/// One of each kind of convergence, in the order of the first regimes.
pub(super) const SERIES: [Series; 4] = [
    Series { name: "linear", limit: 10.0, term: |i| 0.9_f64.powi(i as i32 - 1) },
    Series { name: "alternating", limit: LN_2, term: alternating },
    Series { name: "logarithmic", limit: PI * PI / 6.0, term: |i| f64::from(i).powi(-2) },
    Series { name: "hyperlinear", limit: E, term: inverse_factorial },
];

impl Series {
    /// Its partial sums of these numbers of terms, as a batch and in f64.
    pub(super) fn at(&self, counts: &[u32]) -> (Case, Vec<f64>) {
        series(counts, self.limit, self.term)
    }
}

/// The last eight sample counts.
pub(super) fn window(n: u32) -> Vec<u32> {
    (n - 7..=n).collect()
}

fn alternating(i: u32) -> f64 {
    if i.is_multiple_of(2) { -1.0 / f64::from(i) } else { 1.0 / f64::from(i) }
}

fn inverse_factorial(i: u32) -> f64 {
    (1..i).map(f64::from).product::<f64>().recip()
}

/// Runs of each integrand of a family, with samples changed by a linear map.
fn family(family: Family, counts: &[u32], runs: Runs, map: fn(f64) -> f64) -> Case {
    simulate(counts, runs.lanes(), runs.seed(1), |lane, _| {
        let integrand = family.integrand(lane % COUNT);
        (map(integrand.integral()), move |_: u32, rng: &mut SplitMix64| {
            map(integrand.at(rng.uniform()))
        })
    })
}

/// The same, times a factor of each lane.
fn scaled(family: Family, counts: &[u32], runs: Runs, factor: fn(usize) -> f64) -> Case {
    simulate(counts, runs.lanes(), runs.seed(1), |lane, _| {
        let (integrand, factor) = (family.integrand(lane % COUNT), factor(lane));
        (factor * integrand.integral(), move |_: u32, rng: &mut SplitMix64| {
            factor * integrand.at(rng.uniform())
        })
    })
}

fn firefly(n: u32, runs: Runs, at: u32) -> Case {
    simulate(&window(n), runs.lanes(), runs.seed(1), |lane, _| {
        let integrand = Family::Gaussian.integrand(lane % COUNT);
        let sample = move |i: u32, rng: &mut SplitMix64| {
            let y = integrand.at(rng.uniform());
            if i == at { 1000.0 } else { y }
        };
        (integrand.integral(), sample)
    })
}

/// `shift` makes the bits that each lane's points are shifted by.
fn halton(n: u32, runs: Runs, shift: fn(&mut SplitMix64) -> u32) -> Case {
    simulate(&window(n), runs.lanes(), runs.seed(7), |lane, rng| {
        let integrand: Integrand = Family::Gaussian.integrand(lane % COUNT);
        let shift = shift(rng);
        let sample = move |i: u32, _: &mut SplitMix64| {
            integrand.at(f64::from(i.reverse_bits() ^ shift) / 4_294_967_296.0)
        };
        (integrand.integral(), sample)
    })
}

fn nonfinite(n: u32, runs: Runs) -> Case {
    let mut case = family(Family::Gaussian, &window(n), runs, |y| y);
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let mut terms = case.batch.terms().to_owned();
    let sides = case.batch.sides().map(|(side, values)| (side.clone(), values.to_vec()));
    let mut sides: Vec<(Side, Vec<f32>)> = sides.collect();
    let (rows, lanes) = terms.dim();
    for (k, lane) in (0..lanes).step_by(10).enumerate() {
        terms[[k % rows, lane]] = bad[k % bad.len()];
    }
    for (k, lane) in (5..lanes).step_by(10).enumerate() {
        let fold = k % nst_core::FOLDS;
        sides[fold].1[lane] = bad[k % bad.len()];
    }
    let mut batch = nst_core::SequenceBatch::new(terms, window(n)).expect("as before");
    for (side, values) in sides {
        batch.set_side(side, values).expect("as before");
    }
    case.batch = batch;
    case
}
