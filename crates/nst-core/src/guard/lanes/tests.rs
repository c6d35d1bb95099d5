//! The guard on lanes whose true values are known.

use super::{
    super::{Alone, OfTransform, Seen, sample},
    *,
};
use crate::{
    Grid, LANES_PER_BLOCK, LaneSums, PowerSums, Side, fold_count, random::SplitMix64,
    sequence::tests::Cut,
};

/// Lanes of an integrand, and their true values.
struct Lanes {
    truth: Vec<f64>,
    batch: SequenceBatch,
}

/// How the samples of a lane with the parameters a and b, both in (0, 1), are drawn, and their
/// mean.
type Integrand = fn(a: f64, b: f64, uniform: f64) -> f64;

/// A light that is seen through a share a of the pixel: h · 1[u < a].
fn visibility(a: f64, b: f64, u: f64) -> f64 {
    if u < 0.1 + 0.5 * a { 1.0 + b } else { 0.0 }
}

/// A smooth integrand, some lanes of which are far brighter: (1 + 9 a²) (b + u)².
fn smooth(a: f64, b: f64, u: f64) -> f64 {
    (1.0 + 9.0 * a * a) * (b + u).powi(2)
}

/// Rare bright samples: 1 and in one of 50 cases 100 more.
fn fireflies(a: f64, b: f64, u: f64) -> f64 {
    (0.5 + a) * (1.0 + if u < 0.02 { 100.0 * b } else { 0.0 })
}

/// A Gaussian density on [0, 1] with a mean and a deviation from 0.1 to 0.3, as a network in
/// the crate was trained on.
fn gaussian(a: f64, b: f64, u: f64) -> f64 {
    let deviation = 0.1 + 0.2 * b;
    let z = (u - (0.1 + 0.2 * a)) / deviation;
    (-0.5 * z * z).exp() / (deviation * std::f64::consts::TAU.sqrt())
}

/// The same, a quarter of it or four times it: in one batch, no network has seen it.
fn scaled_gaussian(a: f64, b: f64, u: f64) -> f64 {
    4.0_f64.powi((3.0 * (7.0 * a).fract()) as i32 - 1) * gaussian(a, b, u)
}

/// A Gaussian left of ½, and 0 beyond: at 8 samples, one of 256 lanes is black.
fn gaussian_step(a: f64, b: f64, u: f64) -> f64 {
    if u < 0.5 { gaussian(a, b, u) } else { 0.0 }
}

/// A third of the lanes are black, as a picture's background is, and others seem to be.
fn partly_hidden(a: f64, b: f64, u: f64) -> f64 {
    if u < 0.3 * (a - 1.0 / 3.0) { 1.0 + b } else { 0.0 }
}

const INTEGRANDS: [Integrand; 3] = [visibility, smooth, fireflies];

impl Lanes {
    fn new(integrand: Integrand, lanes: usize, n: u32, seed: u64) -> Self {
        Self::drawn(integrand, lanes, n, seed, |_, _, uniform| uniform)
    }

    /// Each fold has one sample in each of n / 4 equal parts of the circle [0, 1), which begin
    /// anywhere: as with a randomised sequence of low discrepancy, folds are independent, and the
    /// mean of each has far less variance than that of independent samples.
    fn stratified(integrand: Integrand, lanes: usize, n: u32, seed: u64) -> Self {
        let folds = FOLDS as u32;
        assert!(n.is_multiple_of(folds));
        let in_its_part = |lane: usize, index: u32, uniform: f64| {
            let fold = lane as u64 * u64::from(folds) + u64::from(index % folds);
            let begin = SplitMix64::of_stream(seed, 1 + fold).uniform();
            (begin + (f64::from(index / folds) + uniform) / f64::from(n / folds)).fract()
        };
        Self::drawn(integrand, lanes, n, seed, in_its_part)
    }

    /// `place` makes the number in [0, 1) of a lane's sample from its index and a uniform number.
    fn drawn(
        integrand: Integrand,
        lanes: usize,
        n: u32,
        seed: u64,
        place: impl Fn(usize, u32, f64) -> f64,
    ) -> Self {
        let mut random = SplitMix64::of_stream(seed, 0);
        // The parameters vary from run to run, as pixels do.
        let parameters: Vec<[f64; 2]> =
            (0..lanes).map(|_| [random.uniform(), random.uniform()]).collect();
        let sample = |lane: usize, u: f64| integrand(parameters[lane][0], parameters[lane][1], u);
        let mut sums = vec![LaneSums::default(); lanes];
        // Of many samples no test needs them, and they take their time.
        let further: Vec<Power> = Power::all().filter(|_| n <= 1024).collect();
        let mut powers = PowerSums::new(&further, lanes);
        for index in 0..n {
            for (lane, sums) in sums.iter_mut().enumerate() {
                let u = place(lane, index, random.uniform());
                let sample = f64::from(sample(lane, u) as f32);
                sums.add(index, sample);
                powers.add(lane, index, sample);
            }
        }
        const STEPS: u32 = 1000;
        let of_lane = |lane: usize| {
            let steps = (0..STEPS).map(|i| sample(lane, (f64::from(i) + 0.5) / f64::from(STEPS)));
            steps.sum::<f64>() / f64::from(STEPS)
        };
        let means: Vec<f32> = sums.iter().map(|it| (it.total() / f64::from(n)) as f32).collect();
        let mut batch = SequenceBatch::from_last(&means, n).expect("a mean of each lane");
        batch.set_sums(&sums, n).expect("sums of each lane");
        batch.set_power_sums(&powers, n).expect("sums of each lane");
        Self { truth: (0..lanes).map(of_lane).collect(), batch }
    }

    fn mse(&self, estimates: &[f32]) -> f64 {
        let errors = estimates.iter().zip(&self.truth).map(|(x, i)| (f64::from(*x) - i).powi(2));
        errors.sum::<f64>() / self.truth.len() as f64
    }

    /// The MSE ratio of a guard, and its judgement.
    fn ratio(&self, guard: &Guard) -> (f64, Judgement) {
        let fitted = guard.measure(&mut crate::Whole::new(&self.batch)).expect("a batch");
        let mut out = Estimates::default();
        fitted.apply(&self.batch, &mut out).expect("a batch");
        (self.mse(out.values()) / self.mse(self.batch.last()), fitted.judgement().clone())
    }
}

/// An expert by a closure.
struct By<F>(&'static str, F);

impl<F: Fn(usize, &Seen<'_>) -> f64 + Send + Sync> Expert for By<F> {
    fn name(&self) -> &str {
        self.0
    }

    fn estimate(&self, seen: &Seen<'_>, out: &mut [f32]) -> Result<(), Error> {
        for (lane, out) in out.iter_mut().enumerate() {
            *out = (self.1)(lane, seen) as f32;
        }
        Ok(())
    }
}

fn with(expert: impl Expert + 'static) -> Guard {
    Guard::new(vec![Box::new(expert)]).expect("one expert")
}

fn of_samples(name: &str) -> crate::SampleMlp {
    let network = crate::SampleNetwork::builtin(name).expect("it is in the crate");
    crate::SampleMlp::new(name, network.expect("it is readable"))
}

/// The network gives what it has learnt. With other integrals and with more samples it is out of
/// its depth: the guard keeps it out, and its last layer fitted again gains.
#[test]
fn networks_that_see_samples() {
    let network = || of_samples("gaussian-samples");
    let guards = [Guard::default(), with(network()), with(network().with_refit())];
    let cases: [(Integrand, u32); 7] = [
        (gaussian, 8),
        (gaussian, 64),
        (gaussian, 1024),
        (scaled_gaussian, 8),
        (scaled_gaussian, 64),
        (visibility, 64),
        (fireflies, 64),
    ];
    let ratios = cases.map(|(integrand, n)| {
        let runs = [1, 2].map(|seed| Lanes::new(integrand, 6000, n, seed));
        let ratios = guards.each_ref().map(|guard| {
            runs.iter().map(|lanes| lanes.ratio(guard).0).sum::<f64>() / runs.len() as f64
        });
        let [alone, ..] = ratios;
        // At the worst it takes from the others what is noise.
        assert!(ratios.iter().all(|ratio| *ratio < 1.01 * alone), "{n} samples: {ratios:?}");
        ratios
    });
    // 5 % above what is measured.
    for (case, most) in [(0, 0.048), (1, 0.0645)] {
        let [_, with_network, refitted] = ratios[case];
        assert!(with_network < most && refitted < most, "{:?}", ratios[case]);
    }
    for case in [2, 3, 4, 6] {
        let [_, with_network, refitted] = ratios[case];
        assert!(refitted < 0.9 * with_network, "case {case}: {:?}", ratios[case]);
    }
}

/// One sample of a thousand is 1, all others are 0: without a fold, lanes are 0 or 1/6, and with all
/// of them 0 or 1/8, which a regression has never seen. It may say the contrary of what was held
/// against samples; without a look at that, 1.53 for the last of these seeds.
#[test]
fn what_folds_say_is_not_extrapolated() {
    const LANES: usize = 9000;
    for seed in [2, 4502, 10_002, 15_002, 2502] {
        let mut sums = vec![LaneSums::default(); LANES];
        for (lane, sums) in sums.iter_mut().enumerate() {
            let mut random = SplitMix64::of_stream(seed, lane as u64);
            (0..8).for_each(|i| sums.add(i, f64::from(u8::from(random.uniform() < 1e-3))));
        }
        let means: Vec<f32> = sums.iter().map(|sums| (sums.total() / 8.0) as f32).collect();
        let mut batch = SequenceBatch::from_last(&means, 8).expect("a mean of each lane");
        batch.set_sums(&sums, 8).expect("sums of each lane");
        let lanes = Lanes { truth: vec![1e-3; LANES], batch };
        // Twice what is measured.
        let (ratio, _) = lanes.ratio(&Guard::default());
        assert!(ratio < 0.13, "seed {seed}: {ratio}");
    }
}

/// The four networks of the families of integrals.
fn of_families() -> Guard {
    let names = ["families-samples", "gaussian-samples", "step-samples", "gaussian-step-samples"];
    let expert = |name: &&str| -> Box<dyn Expert> {
        let network = of_samples(name);
        Box::new(if *name == names[0] { network.with_refit() } else { network })
    };
    Guard::new(names.iter().map(expert).collect()).expect("four experts, one of them refitted")
}

/// At 8 samples, the guard tells the best network from those that know less of such integrals,
/// although without a fold these gain nearly as much.
#[test]
fn the_best_network_is_found_at_few_samples() {
    // 5 % above what is measured.
    for (integrand, most) in [(gaussian as Integrand, 0.0468), (gaussian_step, 0.0331)] {
        for seed in [1, 2, 3] {
            let (ratio, judgement) = Lanes::new(integrand, 9000, 8, seed).ratio(&of_families());
            assert!(ratio < most, "{seed}: {ratio} {judgement:?}");
            // It does not promise more than it keeps.
            assert!(judgement.ratio > 0.9 * ratio, "{seed}: {ratio} {judgement:?}");
        }
    }
}

/// What seems to be black gains from experts, beside what is black.
#[test]
fn black_lanes_may_change() {
    for (n, most) in [(8, 0.85), (32, 0.97)] {
        for seed in [1, 2, 3] {
            let lanes = Lanes::new(partly_hidden, 9000, n, seed);
            let [alone, with_networks] =
                [Guard::default(), of_families()].map(|guard| lanes.ratio(&guard).0);
            assert!(with_networks < most * alone, "{n}, {seed}: {with_networks} {alone}");
        }
    }
}

/// A last layer that is fitted to three quarters of the samples is told to see as many in all:
/// otherwise it seems to gain five times of what it does, and is preferred to a better network.
#[test]
fn what_is_fitted_again_does_not_extrapolate() {
    let experts: Vec<Box<dyn Expert>> = vec![
        Box::new(of_samples("gaussian-samples")),
        Box::new(of_samples("families-samples").with_refit()),
    ];
    let guard = Guard::new(experts).expect("two experts, one of them refitted");
    let (ratio, judgement) = Lanes::new(gaussian, 9000, 16, 1).ratio(&guard);
    assert!(ratio < 0.057 && judgement.ratio > 0.8 * ratio, "{ratio} {judgement:?}");
}

/// A batch without the means that a network needs: the guard goes on without it.
#[test]
fn a_network_without_its_means_is_left_out() {
    let lanes = Lanes::new(gaussian, 3000, 16, 1);
    let mut batch = SequenceBatch::from_last(lanes.batch.last(), 16).expect("as before");
    let missing = Side::power_means(Power::of_value(8.0).expect("a power of two"));
    for (side, values) in lanes.batch.sides().filter(|(side, _)| **side != missing[2]) {
        batch.set_side(side.clone(), values.to_vec()).expect("as before");
    }
    let network = || of_samples("gaussian-samples").with_refit();
    let (alone, _) = lanes.ratio(&Guard::default());
    let (ratio, judgement) = Lanes { batch, ..lanes }.ratio(&with(network()));
    assert_eq!((ratio, judgement.experts.len()), (alone, CORRECTIONS.len()));
    let note = "'gaussian-samples' is left out: ";
    let said = judgement.notes[0].starts_with(note) && judgement.notes[0].contains("power 8");
    assert!(said, "{:?}", judgement.notes);
}

/// What a network makes of all samples, without the guard: the same however the batch is cut;
/// where there is nothing to see, the plain estimates.
#[test]
fn an_expert_alone() {
    let lanes = Lanes::new(gaussian, 6000, 16, 1);
    let alone = Alone::new(of_samples("gaussian-samples"));
    let estimates = |batch: &SequenceBatch| {
        let mut out = Estimates::default();
        alone.transform(batch, &mut out).map(|()| out)
    };
    let out = estimates(&lanes.batch).expect("a batch with its means");
    // 5 % above what is measured.
    let ratio = lanes.mse(out.values()) / lanes.mse(lanes.batch.last());
    assert!(ratio < 0.0575 && out.count(Status::Ok) == 6000, "{ratio}");
    let cut = |step: usize| {
        let mut strips = Cut { batch: &lanes.batch, step, next: 0 };
        let fitted = alone.fit(&mut strips).expect("strips");
        strips.rewind(0).expect("strips");
        let (mut out, mut values) = (Estimates::default(), Vec::new());
        while let Some(strip) = strips.next_strip().expect("strips") {
            fitted.apply(&strip, &mut out).expect("a strip");
            values.extend_from_slice(out.values());
        }
        values
    };
    assert_eq!(cut(LANES_PER_BLOCK), out.values());
    let plain = |out: &Estimates, batch: &SequenceBatch| out.values() == batch.last();
    let without = SequenceBatch::from_last(lanes.batch.last(), 16).expect("means");
    let out = estimates(&without).expect("no folds are no error");
    assert!(plain(&out, &without) && out.count(Status::NoFolds) == 6000);
    let black = SequenceBatch::from_samples(50, &[0.0; 400]).expect("black samples");
    let out = estimates(&black).expect("black is no error");
    assert!(plain(&out, &black) && out.count(Status::Constant) == 50);
    // A few black lanes beside others.
    let lanes = Lanes::new(gaussian_step, 6000, 8, 1);
    let is_black = |lane: &usize| lanes.batch.last()[*lane] == 0.0;
    let black: Vec<usize> = (0..6000).filter(is_black).collect();
    let out = estimates(&lanes.batch).expect("a batch with its means");
    let kept = black.iter().all(|&lane| out.values()[lane] == 0.0);
    assert!(kept && (5..100).contains(&black.len()), "{}", black.len());
    let few = SequenceBatch::from_samples(50, &[1.0; 150]).expect("three samples");
    assert!(plain(&estimates(&few).expect("three samples are no error"), &few));
    let usual = SequenceBatch::from_samples(50, &[0.5; 400]).expect("samples");
    let error = estimates(&usual).expect_err("it has no means of further powers").to_string();
    assert!(error.contains("to the power 0.125"), "{error}");
}

/// Where there is something to be learnt it is learnt, from the batch alone; nowhere is T
/// worse than S by more than 2 %.
#[test]
fn gains_and_never_harms() {
    let mut least = [f64::INFINITY; 3];
    for (kind, integrand) in INTEGRANDS.into_iter().enumerate() {
        for n in [4, 8, 32, 256] {
            let ratios =
                [1, 2].map(|seed| Lanes::new(integrand, 6000, n, seed).ratio(&Guard::default()).0);
            let ratio = (ratios[0] + ratios[1]) / 2.0;
            assert!(ratio < 1.02, "integrand {kind}, {n} samples: {ratio}");
            least[kind] = least[kind].min(ratio);
        }
    }
    // The height of a light is known from its bright samples, so that it counts them only; of
    // smooth lanes too; fireflies are missed or not.
    assert!(least[0] < 0.8 && least[1] < 0.9 && least[2] < 0.8, "{least:?}");
}

/// Nonsense gets no weight.
#[test]
fn garbage_changes_nothing() {
    let noise = By("noise", |lane: usize, seen: &Seen<'_>| {
        let bits = seen.mean[lane].to_bits();
        seen.unit * (SplitMix64::of_stream(u64::from(bits), lane as u64).uniform() - 0.5)
    });
    let constant = By("constant", |_, _: &Seen<'_>| 1e3);
    let nan = By("nan", |_, _: &Seen<'_>| f64::NAN);
    let stranger = By("stranger", |lane: usize, seen: &Seen<'_>| {
        let there = (lane * 7919 + 13) % seen.mean.len();
        f64::from(seen.mean[there])
    });
    let guards = [with(noise), with(constant), with(nan), with(stranger)];
    for (kind, integrand) in INTEGRANDS.into_iter().enumerate() {
        let runs = [5, 6, 7, 8].map(|seed| Lanes::new(integrand, 6000, 16, seed));
        let mean = |guard: &Guard| runs.iter().map(|lanes| lanes.ratio(guard).0).sum::<f64>() / 4.0;
        let alone = mean(&Guard::default());
        for guard in &guards {
            let ratio = mean(guard);
            let name = guard.experts[0].name();
            assert!(ratio < 1.01 * alone, "{name} on integrand {kind}: {ratio}, not {alone}");
        }
    }
    // One that knows the truth gets all of it: the weights can tell.
    let truth = Lanes::new(smooth, 3000, 16, 5);
    let known = truth.truth.clone();
    let oracle = with(By("oracle", move |lane: usize, _: &Seen<'_>| known[lane % known.len()]));
    let (ratio, judgement) = truth.ratio(&oracle);
    assert!(ratio < 0.15 && judgement.experts[3].1 > 0.6, "{ratio} {judgement:?}");
}

/// An expert with a constant bias counts at few samples, and not at many.
#[test]
fn converges_whatever_the_bias() {
    let biased = |lanes: usize, n: u32| {
        let lanes = Lanes::new(visibility, lanes, n, 9);
        let (alone, _) = lanes.ratio(&Guard::default());
        let known = lanes.truth.clone();
        let expert = By("biased", move |lane: usize, _: &Seen<'_>| known[lane % known.len()] + 0.3);
        let (ratio, judgement) = lanes.ratio(&with(expert));
        (ratio / alone, judgement.experts[CORRECTIONS.len()].1)
    };
    let (few, weight) = biased(2000, 4);
    assert!(few < 0.5 && weight > 0.3, "{few} {weight}");
    for (lanes, n) in [(2000, 4096), (500, 65_536)] {
        let (many, weight) = biased(lanes, n);
        assert!((many - 1.0).abs() < 0.01 && weight < 0.03, "{n} samples: {many} {weight}");
    }
}

type Drawn = fn(Integrand, usize, u32, u64) -> Lanes;

/// The interval contains the true ratio in 90 of 100 cases, at least, also where the samples of a
/// fold depend on each other.
#[test]
fn predicts_its_gain() {
    for (drawn, name) in [(Lanes::new as Drawn, "random"), (Lanes::stratified, "stratified")] {
        let (mut inside, mut count) = (0, 0);
        for integrand in INTEGRANDS {
            for n in [8, 32] {
                for seed in 0..10 {
                    let lanes = drawn(integrand, 3000, n, 100 + seed);
                    let (ratio, judgement) = lanes.ratio(&Guard::default());
                    let [low, high] = judgement.interval;
                    assert!(low <= judgement.ratio && judgement.ratio <= high);
                    inside += u32::from((low..=high).contains(&ratio));
                    count += 1;
                }
            }
        }
        assert!(10 * inside >= 9 * count, "{name}: {inside} of {count}");
    }
}

/// The variance of S by that of the folds' means is right, also where not all folds have as many
/// samples: 7 % more or less would be those of equal folds.
#[test]
fn folds_of_any_size_say_how_s_varies() {
    for n in [4, 5, 6, 7, 8] {
        let counts: [f64; FOLDS] = std::array::from_fn(|fold| fold_count(fold, n));
        let weights = sample::dispersion(&counts);
        let mut random = SplitMix64::of_stream(5, n.into());
        let (mut sum, lanes) = (0.0, 20_000);
        for _ in 0..lanes {
            let of_fold = |count: f64| (0..count as u32).map(|_| random.uniform()).sum::<f64>();
            let sums = counts.map(of_fold);
            let total: f64 = sums.iter().sum();
            for (fold, weight) in weights.into_iter().enumerate() {
                let others = (total - sums[fold]) / (f64::from(n) - counts[fold]);
                sum += weight * (sums[fold] / counts[fold] - others).powi(2);
            }
        }
        // Of uniform numbers, known. The tolerance is five standard errors, √(2/3/20000) each.
        let ratio = sum / f64::from(lanes) * 12.0 * f64::from(n);
        assert!((ratio - 1.0).abs() < 0.03, "{n} samples: {ratio}");
    }
}

/// What an expert that knows much gains is the more, the larger the errors of S are, not those
/// that as many independent samples would have.
#[test]
fn predicts_its_gain_where_samples_depend_on_each_other() {
    for (integrand, n) in [(visibility as Integrand, 8), (visibility, 32), (smooth, 8)] {
        for seed in 0..3 {
            let lanes = Lanes::stratified(integrand, 3000, n, 200 + seed);
            let known = lanes.truth.clone();
            let knows = By("knows", move |lane: usize, _: &Seen<'_>| known[lane % known.len()]);
            let (ratio, judgement) = lanes.ratio(&with(knows));
            let [low, high] = judgement.interval;
            assert!((low..=high).contains(&ratio), "{n}: {ratio} {judgement:?}");
        }
    }
}

/// The standard errors of estimates are those that they have, within a factor of 1.5 in the mean
/// square, for dark lanes as for bright ones.
#[test]
fn knows_its_errors() {
    let cases = [
        (visibility as Integrand, Lanes::new as Drawn),
        (smooth, Lanes::new),
        (visibility, Lanes::stratified),
        (smooth, Lanes::stratified),
    ];
    for (kind, (integrand, drawn)) in cases.into_iter().enumerate() {
        for n in [8, 64] {
            let lanes = drawn(integrand, 6000, n, 40);
            let mut out = Estimates::default();
            Guard::default().transform(&lanes.batch, &mut out).expect("a batch");
            let mut order: Vec<usize> = (0..6000).collect();
            order.sort_by(|&a, &b| lanes.truth[a].total_cmp(&lanes.truth[b]));
            for part in order.chunks(2000) {
                let mean = |of_lane: &dyn Fn(usize) -> f64| -> f64 {
                    part.iter().map(|&lane| of_lane(lane)).sum::<f64>() / part.len() as f64
                };
                let squares = |values: &[f32]| {
                    mean(&|lane| (f64::from(values[lane]) - lanes.truth[lane]).powi(2))
                };
                let estimated = mean(&|lane| f64::from(out.errors()[lane]).powi(2));
                let ratio = estimated / squares(out.values());
                assert!((1.0 / 1.5..1.5).contains(&ratio), "case {kind}, {n}: {ratio}");
            }
        }
    }
}

/// Where samples depend on each other, what may be gained is little beside the variance of as many
/// independent ones, and yet much of the errors of S.
#[test]
fn gains_are_seen_beside_the_true_variance() {
    // The mean over seeds; 5 % above what is measured.
    for (integrand, most) in [(visibility as Integrand, 0.985), (smooth, 0.905)] {
        let ratio = |seed| Lanes::stratified(integrand, 6000, 32, seed).ratio(&Guard::default()).0;
        let ratios = [300, 301, 302].map(ratio);
        assert!(ratios.iter().sum::<f64>() / 3.0 < most, "{ratios:?}");
    }
}

/// A unit changes no bit, if it is a power of two.
#[test]
fn has_no_unit() {
    let lanes = Lanes::new(smooth, 2000, 16, 3);
    let samples = |factor: f32| {
        let mut random = SplitMix64::of_stream(3, 7);
        (0..16 * 500).map(|_| factor * (random.uniform() as f32).powi(3)).collect::<Vec<_>>()
    };
    let estimates = |factor: f32| {
        let batch = SequenceBatch::from_samples(500, &samples(factor)).expect("16 samples");
        let mut out = Estimates::default();
        Guard::default().transform(&batch, &mut out).expect("a batch");
        out.values().to_vec()
    };
    let scaled: Vec<f32> = estimates(1.0).iter().map(|x| 64.0 * x).collect();
    assert_eq!(estimates(64.0), scaled);
    assert_ne!(estimates(1.0), lanes.batch.last()[..500]);
}

/// The same bits, however the batch is cut; also where a part of the pixels is learnt from.
#[test]
fn strips_make_no_difference() -> Result<(), Error> {
    let check = |batch: &SequenceBatch, steps: &[usize]| -> Result<(), Error> {
        let guard = with(of_samples("step-samples").with_refit());
        let whole = guard.measure(&mut crate::Whole::new(batch))?;
        for &step in steps {
            let cut = guard.measure(&mut Cut { batch, step, next: 0 })?;
            assert_eq!(cut.judgement(), whole.judgement(), "strips of {step}");
            let (mut a, mut b) = (Estimates::default(), Estimates::default());
            whole.apply(batch, &mut a)?;
            cut.apply(batch, &mut b)?;
            assert_eq!(a, b, "strips of {step}");
            // Also where they are not read by the guard, but given to it.
            let mut learning = guard.start().expect("one pass is enough");
            let mut strips = Cut { batch, step, next: 0 };
            while let Some(strip) = strips.next_strip()? {
                learning.add(&strip)?;
            }
            let given = learning.finish()?;
            assert_eq!(given.judgement(), Some(whole.judgement()), "strips of {step}");
            given.apply(batch, &mut b)?;
            assert_eq!(a, b, "strips of {step}");
        }
        let [low, high] = whole.judgement().interval;
        assert!(low < high && whole.judgement().ratio < 1.0);
        Ok(())
    };
    let mut picture = Lanes::new(visibility, 3 * 50 * 41, 8, 2).batch;
    picture.set_grid(Grid::new(50, 41, 3, 0)?)?;
    check(&picture, &[1, 7, 40])?;
    let many = Lanes::new(visibility, 80_000, 4, 2).batch;
    check(&many, &[LANES_PER_BLOCK, 3 * LANES_PER_BLOCK])
}

/// What there is nothing to learn from keeps S, and says why.
#[test]
fn falls_back_to_the_plain_estimate() {
    let few = Lanes::new(visibility, 100, 3, 1).batch;
    let bare = SequenceBatch::from_last(&[1.0, 2.0, 3.0], 8).expect("three lanes");
    let black = SequenceBatch::from_samples(7, &[0.0; 7 * 8]).expect("eight samples");
    for (batch, why) in [(few, "statistics"), (bare, "statistics"), (black, "all estimates are 0")]
    {
        let guard = Guard::default();
        let fitted = guard.measure(&mut crate::Whole::new(&batch)).expect("a batch");
        let mut out = Estimates::default();
        fitted.apply(&batch, &mut out).expect("a batch");
        assert_eq!(out.values(), batch.last());
        let judgement = fitted.judgement();
        assert_eq!((judgement.ratio, judgement.interval), (1.0, [1.0; 2]));
        assert!(judgement.notes[0].contains(why), "{judgement:?}");
    }
    // One lane, ten lanes: too few to learn from.
    for count in [1, 10] {
        let lanes = Lanes::new(smooth, count, 16, 4);
        let (ratio, _) = lanes.ratio(&Guard::default());
        assert!((0.5..1.2).contains(&ratio), "{count} lanes: {ratio}");
    }
}

/// A lane with a number that is not finite keeps it, and spoils no other.
#[test]
fn one_bad_sample_spoils_one_lane() {
    let mut lanes = Lanes::new(visibility, 3000, 16, 8);
    let bad = 17;
    for kind in Side::OF_FOLDS {
        let mut values = lanes.batch.side(&kind[2]).expect("a mean").to_vec();
        values[bad] = f32::NAN;
        lanes.batch.set_side(kind[2].clone(), values).expect("a mean");
    }
    let mut out = Estimates::default();
    Guard::default().transform(&lanes.batch, &mut out).expect("a batch");
    assert_eq!(out.status()[bad], Status::NotFinite);
    assert_eq!(out.values()[bad], lanes.batch.last()[bad]);
    assert!(out.count(Status::NotFinite) == 1 && out.values().iter().all(|x| x.is_finite()));
    assert!(lanes.mse(out.values()) < 0.9 * lanes.mse(lanes.batch.last()));
}

/// Methods that see more than what is not held out cannot be experts.
#[test]
fn what_cannot_be_held_out_is_refused() {
    use crate::methods::{Aitken, Gmon, PriorMean};
    assert!(OfTransform::new("identity", crate::Identity).is_ok());
    let why = |error: Error| error.to_string();
    let of = |error: Option<Error>| error.map(why).expect("an error");
    assert!(of(OfTransform::new("aitken", Aitken).err()).contains("window of terms"));
    assert!(of(OfTransform::new("gmon", Gmon).err()).contains("side channels"));
    assert!(of(OfTransform::new("mean", PriorMean::OfTheBatch).err()).contains("all samples"));
    let many = (0..=5).map(|_| Box::new(By("x", |_, _: &Seen<'_>| 0.0)) as Box<dyn Expert>);
    assert!(Guard::new(many.collect()).is_err());
    // Those that are fitted again count twice.
    let many = |count: usize| {
        let expert = || Box::new(of_samples("step-samples").with_refit()) as Box<dyn Expert>;
        Guard::new((0..count).map(|_| expert()).collect())
    };
    assert!(many(2).is_ok());
    assert!(of(many(3).err()).contains("3 experts, 3 of them also refitted"));
}

/// An expert that fails is left out, and named.
#[test]
fn an_expert_that_fails_is_left_out() {
    struct Fails;
    impl Expert for Fails {
        fn name(&self) -> &str {
            "fails"
        }

        fn estimate(&self, _: &Seen<'_>, _: &mut [f32]) -> Result<(), Error> {
            Err(Error::Batch("it is out of order".into()))
        }
    }
    let lanes = Lanes::new(visibility, 3000, 8, 6);
    let (alone, _) = lanes.ratio(&Guard::default());
    let (ratio, judgement) = lanes.ratio(&with(Fails));
    assert_eq!((ratio, judgement.experts.len()), (alone, CORRECTIONS.len()));
    assert!(judgement.notes[0].contains("'fails' is left out: "), "{judgement:?}");
}

/// One that fails when the estimates are made leaves S, and the lanes say so.
#[test]
fn an_expert_that_fails_late_leaves_the_plain_estimates() {
    use std::sync::atomic::{AtomicUsize, Ordering};
    let lanes = Lanes::new(visibility, 3000, 8, 6);
    let (calls, known) = (AtomicUsize::new(0), lanes.truth.clone());
    let breaks = move |seen: &Seen<'_>, out: &mut [f32]| {
        if calls.fetch_add(1, Ordering::Relaxed) > GROUPS {
            return Err(Error::Batch("it broke down".into()));
        }
        out.iter_mut().zip(&known).for_each(|(out, truth)| *out = *truth as f32);
        assert_eq!(seen.mean.len(), known.len());
        Ok(())
    };
    struct Breaks<F>(F);
    impl<F: Fn(&Seen<'_>, &mut [f32]) -> Result<(), Error> + Send + Sync> Expert for Breaks<F> {
        fn name(&self) -> &str {
            "breaks"
        }

        fn estimate(&self, seen: &Seen<'_>, out: &mut [f32]) -> Result<(), Error> {
            (self.0)(seen, out)
        }
    }
    let mut out = Estimates::default();
    with(Breaks(breaks)).transform(&lanes.batch, &mut out).expect("no error");
    assert_eq!(out.values(), lanes.batch.last());
    assert_eq!(out.count(Status::ExpertFailed), 3000);
}

/// Pictures of 16 samples each that were packed count as one sample each: the estimates are
/// those of the same means with a count of 1.
#[test]
fn packed_pictures_are_samples() -> Result<(), Error> {
    let Lanes { batch, .. } = Lanes::new(visibility, 3000, 24, 8);
    let counts = batch.sample_counts().iter().map(|n| 16 * n).collect();
    let mut packed = SequenceBatch::new(batch.terms().to_owned(), counts)?;
    for (side, values) in batch.sides() {
        packed.set_side(side.clone(), values.to_vec())?;
    }
    let [mut single, mut of_pictures] = [Estimates::default(), Estimates::default()];
    Guard::default().transform(&batch, &mut single)?;
    Guard::default().transform(&packed, &mut of_pictures)?;
    assert_eq!(single, of_pictures);
    assert_ne!(single.values(), batch.last());
    Ok(())
}
