//! A million random lanes through every method: none may panic, return a number
//! that is not finite without need, or return S_n's replacement without saying so.

use std::collections::BTreeMap;

use ndarray::Array2;
use nst_core::{
    Estimates, FOLDS, Grid, MlpCpu, Network, SequenceBatch, Side, Status, Transform,
    methods::{METHODS, method},
    random::SplitMix64,
};

struct Rng(SplitMix64);

impl Rng {
    fn next(&mut self) -> u64 {
        self.0.next_u64()
    }

    fn below(&mut self, bound: usize) -> usize {
        self.0.below(bound)
    }

    fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / 16_777_216.0
    }

    /// 10^x with x uniform, of either sign.
    fn magnitude(&mut self, least: f32, greatest: f32) -> f32 {
        let x = 10.0_f32.powf(least + (greatest - least) * self.unit());
        if self.below(2) == 0 { x } else { -x }
    }
}

/// One lane of `terms` terms, of one of the kinds that have broken such methods.
fn lane(rng: &mut Rng, terms: usize) -> Vec<f32> {
    let base = rng.magnitude(-3.0, 3.0);
    let ratio = 2.2 * rng.unit() - 1.1;
    let kind = rng.below(11);
    let mut value = base;
    let mut terms: Vec<f32> = (0..terms)
        .map(|k| match kind {
            // Any bits: subnormals, infinities, NaNs among them.
            0 => f32::from_bits(rng.next() as u32),
            1 => rng.magnitude(-45.0, 38.5),
            2 => f32::from_bits(rng.below(1 << 23) as u32), // subnormals and 0
            3 => base,
            4 => base + base * f32::EPSILON * rng.below(3) as f32, // rounding alone
            5 => base + ratio.powi(k as i32),                      // geometric
            6 => base + base * k as f32,                           // Δ² = 0
            7 => (k as f32).exp2() * base,                         // diverges
            8 => [0.0, 0.0, 0.0, base][rng.below(4)],
            9 => base + rng.unit() / (k + 1) as f32,
            _ => {
                value += (rng.unit() - value) / (k + 1) as f32; // running means
                value
            }
        })
        .collect();
    if rng.below(8) == 0 {
        let special = [f32::NAN, f32::INFINITY, f32::MAX, f32::MIN_POSITIVE, -0.0, f32::MIN];
        let place = rng.below(terms.len());
        terms[place] = special[rng.below(6)];
    }
    terms
}

/// Consecutive counts from anywhere, or any steps.
fn sample_counts(rng: &mut Rng, terms: usize) -> Vec<u32> {
    let consecutive = rng.below(2) == 0;
    let mut count = 1 << rng.below(20);
    (0..terms)
        .map(|_| {
            let now = count;
            count += if consecutive { 1 } else { 1 + rng.below(1 << 12) as u32 };
            now
        })
        .collect()
}

fn batch(rng: &mut Rng, lanes: usize) -> SequenceBatch {
    let terms = 1 + rng.below(10);
    let lanes_by_terms: Vec<f32> = (0..lanes).flat_map(|_| lane(rng, terms)).collect();
    let array = Array2::from_shape_vec((lanes, terms), lanes_by_terms).expect("the shape");
    let counts = sample_counts(rng, terms);
    let mut batch = SequenceBatch::new(array.reversed_axes(), counts).expect("counts increase");
    if rng.below(4) > 0 {
        let folds: Vec<_> = (0..lanes).map(|_| lane(rng, 3 * FOLDS)).collect();
        // Some batches have the folds alone.
        let most = if rng.below(4) == 0 { FOLDS } else { 3 * FOLDS };
        for (k, side) in Side::EVERY_OF_FOLDS.iter().take(most).enumerate() {
            let fold = folds.iter().map(|folds| folds[k]).collect();
            batch.set_side(side.clone(), fold).expect("a value per lane");
        }
    }
    if rng.below(4) > 0 {
        let row = Grid::new(lanes as u32, 1, 1, 0).expect("a picture of one row");
        batch.set_grid(row).expect("its lanes");
    }
    batch
}

/// What is wrong with an output, if anything.
fn fault(batch: &SequenceBatch, out: &Estimates) -> Option<String> {
    let (values, status, last) = (out.values(), out.status(), batch.last());
    if values.len() != last.len() || status.len() != last.len() {
        return Some(format!("{} values, {} statuses", values.len(), status.len()));
    }
    (0..last.len()).find_map(|lane| {
        let (t, s, status) = (values[lane], last[lane], status[lane]);
        let wrong = if s.is_finite() && !t.is_finite() {
            "is not finite although S is"
        } else if !t.is_finite() && status == Status::Ok {
            "is not finite and does not say so"
        } else if status != Status::Ok && t != s && !(t.is_nan() && s.is_nan()) {
            "has fallen back to something else than S"
        } else {
            return None;
        };
        let terms = batch.terms().column(lane).to_vec();
        Some(format!("lane {lane} {wrong}: T = {t}, {status:?}, terms {terms:?}"))
    })
}

#[test]
fn a_million_random_lanes() {
    let mut methods: Vec<(&str, Box<dyn Transform>)> = METHODS
        .iter()
        .map(|&(name, _)| (name, method(name).expect("its name is listed")))
        .collect();
    let network = Network::builtin("families").expect("it exists").expect("it is sound");
    methods.push(("families", Box::new(MlpCpu::new(network))));

    let mut out = Estimates::default();
    // What happened, to be sure that the lanes are as varied as they claim to be.
    let mut transformed = vec![0; methods.len()];
    let mut seen = BTreeMap::new();
    let (mut lanes, mut seed) = (0, 0);
    while lanes < 1_000_000 {
        seed += 1;
        let mut rng = Rng(SplitMix64(seed));
        let size = 1 + rng.below(2000);
        let batch = batch(&mut rng, size);
        for ((name, method), transformed) in methods.iter().zip(&mut transformed) {
            method.transform(&batch, &mut out).expect("nothing concerns the whole batch");
            if let Some(fault) = fault(&batch, &out) {
                panic!("{name}, seed {seed}: {fault}");
            }
            *transformed += out.count(Status::Ok);
            for status in out.status() {
                *seen.entry(format!("{status:?}")).or_insert(0) += 1;
            }
        }
        lanes += size;
    }
    let all = ["Clamped", "Constant", "NoFolds", "NotFinite", "Ok", "TooShort", "ZeroDenominator"];
    assert!(seen.keys().eq(all) && seen.values().all(|&count| count > 10_000), "{seen:?}");
    // Methods with long windows see few lanes that they can read, but still many.
    assert!(transformed.iter().all(|&count| count > 50_000), "{transformed:?}");
}

/// The check sees each kind of rubbish that it is there for: a method that returns
/// NaN, and one that changes a value and then says that it fell back.
#[test]
fn the_check_rejects_rubbish() {
    let batch = SequenceBatch::new(ndarray::array![[1.0], [2.0]], vec![1, 2]).expect("two terms");
    let with_nan =
        SequenceBatch::new(ndarray::array![[1.0], [f32::NAN]], vec![1, 2]).expect("two terms");
    let other = SequenceBatch::new(ndarray::array![[1.0], [3.0]], vec![1, 2]).expect("two terms");
    let apply = |name: &str, batch: &SequenceBatch| {
        let mut out = Estimates::default();
        method(name).expect("its name is listed").transform(batch, &mut out).expect("no error");
        out
    };
    assert_eq!(fault(&batch, &apply("an-gn", &batch)), None);
    // Fell back to NaN, of another batch.
    assert!(fault(&batch, &apply("an-gn", &with_nan)).is_some());
    // Fell back, to the S of another batch.
    assert!(fault(&batch, &apply("aitken", &other)).is_some());
    assert_eq!(fault(&other, &apply("aitken", &other)), None);
}
