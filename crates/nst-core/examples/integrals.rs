//! Estimates integrals of a function that you bring, and how good the estimates are.
//!
//!     cargo run --release -p nst-core --example integrals
//!
//! The function here is what a call option pays: max(S − K, 0), where the price S of a share is
//! log-normal. Each option has its own strike price K and its own volatility, and its fair price
//! is the expectation: one integral, one lane. To use a function of your own, replace
//! [`Call::sample`], which draws one sample; nothing else needs to be known of it.

use nst_core::{
    Error, Estimates, Fitted, SequenceBatch, Whole,
    guard::{Guard, Judgement},
    random::SplitMix64,
};

const CALLS: usize = 4000;
const SAMPLES: u32 = 64;

/// A call option.
struct Call {
    strike: f64,
    volatility: f64,
}

impl Call {
    /// What it pays if a number between 0 and 1, evenly distributed, is the share's luck.
    fn sample(&self, luck: f64) -> f64 {
        let price = (self.volatility * normal(luck) - 0.5 * self.volatility.powi(2)).exp();
        (price - self.strike).max(0.0)
    }

    /// Its price, by a quadrature that such a simple function allows.
    fn price(&self) -> f64 {
        const STEPS: usize = 20_000;
        let steps = (0..STEPS).map(|i| self.sample((i as f64 + 0.5) / STEPS as f64));
        steps.sum::<f64>() / STEPS as f64
    }
}

/// The quantile of the normal distribution, within 5e-4 (Abramowitz and Stegun, 26.2.23).
fn normal(p: f64) -> f64 {
    let tail = p.min(1.0 - p).max(1e-12);
    let t = (-2.0 * tail.ln()).sqrt();
    let quantile = t
        - (2.515517 + t * (0.802853 + t * 0.010328))
            / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
    if p < 0.5 { -quantile } else { quantile }
}

fn main() -> Result<(), Error> {
    let mut random = SplitMix64::of_stream(1, 0);
    let calls: Vec<Call> = (0..CALLS)
        .map(|_| Call {
            strike: 0.8 + 0.6 * random.uniform(),
            volatility: 0.1 + 0.3 * random.uniform(),
        })
        .collect();

    // One lane for each integral; samples are independent, and stored [sample][lane].
    let mut samples = Vec::new();
    for _ in 0..SAMPLES {
        samples.extend(calls.iter().map(|call| call.sample(random.uniform()) as f32));
    }
    let batch = SequenceBatch::from_samples(CALLS, &samples)?;

    // The guard learns from the batch itself, by samples that it holds out.
    let guard = Guard::default();
    let fitted = guard.measure(&mut Whole::new(&batch))?;
    let mut estimates = Estimates::default();
    fitted.apply(&batch, &mut estimates)?;

    let Judgement { experts, ratio, interval: [low, high], notes, .. } = fitted.judgement();
    for (name, weight) in experts {
        println!("trusts {name} by {:.0} %", 100.0 * weight);
    }
    notes.iter().for_each(|note| println!("{note}"));
    println!("predicts {ratio:.2} of the plain estimates' MSE (95 %: {low:.2} to {high:.2})");

    let truth: Vec<f64> = calls.iter().map(Call::price).collect();
    let mse = |values: &[f32]| {
        let squares = values.iter().zip(&truth).map(|(x, i)| (f64::from(*x) - i).powi(2));
        squares.sum::<f64>() / CALLS as f64
    };
    println!("the true ratio is {:.2}", mse(estimates.values()) / mse(batch.last()));
    let errors = estimates.errors().iter().map(|error| f64::from(*error).powi(2));
    println!(
        "estimates its root mean square error as {:.5}; it is {:.5}",
        (errors.sum::<f64>() / CALLS as f64).sqrt(),
        mse(estimates.values()).sqrt()
    );
    Ok(())
}
