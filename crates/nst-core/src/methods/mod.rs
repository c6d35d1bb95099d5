//! The methods that need no training: classical extrapolation, robust means, the filter.
//!
//! The classical ones ([`Extrapolation`]) model how a deterministic sequence
//! approaches its limit. The robust ones look at the means of the four folds of
//! a lane's samples ([`Side::Fold`](crate::Side)).

// Loops over lanes and features index several arrays at once, as the formulas do.
#![allow(clippy::needless_range_loop)]

mod a_n_g_n;
mod aitken;
mod epsilon;
mod euler;
mod extrapolation;
mod folds;
mod gmon;
mod levin;
mod median_of_means;
mod prior_mean;
mod reweight;
mod richardson;
mod ridge;
mod theta;

pub use a_n_g_n::{AnGn, Scale};
pub use aitken::{Aitken, IteratedAitken};
pub use epsilon::WynnEpsilon;
pub use euler::Euler;
pub use extrapolation::{Extrapolation, Tile, WIDTH};
pub use gmon::Gmon;
pub use levin::LevinU;
pub use median_of_means::MedianOfMeans;
pub use prior_mean::PriorMean;
pub use reweight::Reweight;
pub use richardson::Richardson;
pub use ridge::Ridge;
pub use theta::BrezinskiTheta;

use crate::{Transform, WelchFilter, guard::Guard};

/// The names that [`method`] knows, and what each is in a few words: classical methods,
/// then robust and fitted ones, then those that look at neighbours.
pub const METHODS: &[(&str, &str)] = &[
    ("aitken", "Aitken's Δ²"),
    ("aitken-iterated", "Aitken's Δ², iterated"),
    ("levin-u", "Levin's u-transformation"),
    ("brezinski-theta", "Brezinski's θ-algorithm"),
    ("wynn-epsilon", "Wynn's ε-algorithm, which is Shanks' transformation"),
    ("euler", "Euler's transformation of alternating series"),
    ("richardson", "Richardson's extrapolation to 1/n = 0"),
    ("an-gn", "the a_n g_n transformation for errors like 1/n"),
    ("an-gn-square", "the a_n g_n transformation for errors like 1/n²"),
    ("an-gn-geometric", "the a_n g_n transformation for geometric errors"),
    ("prior-mean", "one constant for all lanes: what learned methods should beat"),
    ("median-of-means", "the median of the means of the four folds"),
    ("gmon", "between the mean and the median of means, by the Gini coefficient"),
    ("reweight", "folds with outliers get less weight"),
    (
        "auto",
        "the guard: a blend of the plain estimates with experts, as far as samples held out support it",
    ),
    ("ridge", "a regression on the folds, fitted on the picture itself"),
    (
        "filter",
        "averages pixels of a picture that a test cannot tell apart; biased, as no guard checks it",
    ),
];

/// The names in [`METHODS`] of those that need no picture: the others leave lanes without
/// neighbours as they are.
pub fn of_single_lanes() -> impl Iterator<Item = &'static str> {
    let alone = |name: &&str| method(name).is_some_and(|method| method.requires().halo() == 0);
    METHODS.iter().map(|(name, _)| *name).filter(alone)
}

/// The method of a name in [`METHODS`]; `None` for other names.
#[must_use]
pub fn method(name: &str) -> Option<Box<dyn Transform>> {
    Some(match name {
        "prior-mean" => Box::new(PriorMean::OfTheBatch),
        "median-of-means" => Box::new(MedianOfMeans),
        "gmon" => Box::new(Gmon),
        "reweight" => Box::new(Reweight),
        "auto" => Box::new(Guard::default()),
        "ridge" => Box::new(Ridge),
        "filter" => Box::new(WelchFilter::default()),
        _ => Box::new(extrapolation(name)?),
    })
}

/// The classical method of a name in [`METHODS`], for single sequences in f64; `None` for
/// other names.
#[must_use]
pub fn extrapolation(name: &str) -> Option<&'static dyn Extrapolation> {
    Some(match name {
        "aitken" => &Aitken,
        "aitken-iterated" => &IteratedAitken,
        "levin-u" => &LevinU,
        "brezinski-theta" => &BrezinskiTheta,
        "wynn-epsilon" => &WynnEpsilon,
        "euler" => &Euler,
        "richardson" => &Richardson,
        "an-gn" => &AnGn(Scale::Inverse),
        "an-gn-square" => &AnGn(Scale::InverseSquare),
        "an-gn-geometric" => &AnGn(Scale::Geometric),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Error, Estimates, Grid, Requirements, SequenceBatch, Status, Whole, random::SplitMix64,
    };

    #[test]
    fn every_name_is_known() {
        assert!(METHODS.iter().all(|(name, about)| method(name).is_some() && !about.is_empty()));
        assert!(method("Aitken").is_none());
        let others: Vec<_> = METHODS.iter().map(|(name, _)| *name).collect();
        let [alone @ .., "filter"] = &others[..] else { panic!("{others:?}") };
        assert!(of_single_lanes().eq(alone.iter().copied()));
    }

    /// Nothing else need be made of a rendering for the second pass.
    #[test]
    fn methods_are_applied_to_what_they_require() -> Result<(), Error> {
        let mut random = SplitMix64(5);
        let samples: Vec<f32> = (0..12 * 900).map(|_| random.uniform().powi(4) as f32).collect();
        let mut whole = SequenceBatch::from_samples(900, &samples)?;
        whole.set_grid(Grid::new(20, 15, 3, 0)?)?;
        for (name, _) in METHODS {
            let method = method(name).expect("its name is listed");
            let Requirements { window, sides, .. } = method.requires();
            let window = window.min(whole.sample_counts().len());
            let terms = whole.window(window).expect("as many terms").to_owned();
            let counts = whole.sample_counts()[12 - window..].to_vec();
            let mut least = SequenceBatch::new(terms, counts)?;
            least.set_grid(*whole.grid().expect("a grid"))?;
            for side in sides {
                let values = whole.side(side).expect("twelve samples have all");
                least.set_side(side.clone(), values.to_vec())?;
            }
            let fitted = method.fit(&mut Whole::new(&whole))?;
            let [mut of_whole, mut of_least] = [Estimates::default(), Estimates::default()];
            fitted.apply(&whole, &mut of_whole)?;
            fitted.apply(&least, &mut of_least)?;
            assert_eq!(of_least, of_whole, "{name}");
            assert!(of_whole.count(Status::Ok) > 0, "{name}");
        }
        Ok(())
    }
}
