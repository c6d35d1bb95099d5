//! Whether two renderings have the same mean image: a z-test per pixel, with
//! Šidák's correction for the number of pixels, and one of the whole picture.

/// The probability of rejecting two renderings of the same image.
pub const SIGNIFICANCE: f64 = 0.01;

/// Lanes are compared where the standard error is at most this share of the
/// mean. Beyond it a lane is lit by a few rare samples, and its mean is not
/// close to normally distributed.
pub const MAX_RELATIVE_ERROR: f64 = 0.05;

/// The mean of a rendering and the variance of that mean, by lane.
#[derive(Clone, Copy, Debug)]
pub struct Estimate<'a> {
    /// The mean image.
    pub mean: &'a [f32],
    /// The variance of the mean.
    pub variance: &'a [f32],
}

/// The outcome of [`compare`].
#[derive(Clone, Copy, Debug)]
pub struct Comparison {
    /// The largest |z| of a lane.
    pub worst_z: f64,
    /// The largest |z| of a channel's sum over the lanes that were compared.
    /// Channels are apart because they share their paths.
    pub total_z: f64,
    /// Above it, a lane's |z| shows a difference at [`SIGNIFICANCE`].
    pub threshold: f64,
    /// Lanes compared by z.
    pub compared: usize,
    /// Those of them whose |z| is above the threshold.
    pub beyond: usize,
    /// Lanes without noise on either side, compared by value.
    pub exact: usize,
    /// Lanes that are exact but differ by more than rounding.
    pub exact_failures: usize,
    /// Lanes left out by [`MAX_RELATIVE_ERROR`].
    pub left_out: usize,
}

impl Comparison {
    /// Whether no difference was found.
    #[must_use]
    pub fn same(&self) -> bool {
        self.beyond == 0 && self.total_z <= 4.0 && self.exact_failures == 0
    }
}

/// Lanes whose standard error is a smaller share of the mean are not noisy, but rounded.
const ROUNDING: f64 = 1e-6;
/// What sums of some hundred thousand equal numbers are off by in f32, which Mitsuba uses.
const ROUNDED_SUM: f64 = 3e-5;

/// Compares two independent renderings, each of three planar channels.
///
/// # Panics
/// If the images differ in size.
#[must_use]
pub fn compare(a: Estimate<'_>, b: Estimate<'_>) -> Comparison {
    let lanes = a.mean.len();
    assert!([a.variance.len(), b.mean.len(), b.variance.len()] == [lanes; 3]);
    let mut result = Comparison {
        worst_z: 0.0,
        total_z: 0.0,
        threshold: 0.0,
        compared: 0,
        beyond: 0,
        exact: 0,
        exact_failures: 0,
        left_out: 0,
    };
    // By channel: the sum of the differences and its variance.
    let mut totals = [(0.0, 0.0); 3];
    let mut scores = Vec::new();
    for lane in 0..lanes {
        let [ma, va, mb, vb] =
            [a.mean, a.variance, b.mean, b.variance].map(|values| f64::from(values[lane]));
        let (difference, variance) = (ma - mb, va + vb);
        if variance.sqrt() <= ROUNDING * mb.abs() {
            result.exact += 1;
            let same = difference.abs() <= ROUNDED_SUM * mb.abs();
            result.exact_failures += usize::from(!same);
            continue;
        }
        // False for a NaN.
        let certain = va.max(vb).sqrt() <= MAX_RELATIVE_ERROR * ma.max(mb);
        if !certain {
            result.left_out += 1;
            continue;
        }
        scores.push(difference.abs() / variance.sqrt());
        let (total, total_variance) = &mut totals[3 * lane / lanes];
        *total += difference;
        *total_variance += variance;
    }
    for (total, variance) in totals {
        if variance > 0.0 {
            result.total_z = result.total_z.max(f64::abs(total) / f64::sqrt(variance));
        }
    }
    let tests = scores.len().max(1) as f64;
    result.threshold = two_sided_quantile(1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / tests));
    result.compared = scores.len();
    result.beyond = scores.iter().filter(|&&z| z > result.threshold).count();
    result.worst_z = scores.into_iter().fold(0.0, f64::max);
    result
}

/// The largest |z| of a channel's sum over all lanes: for pictures so noisy that
/// leaving out uncertain lanes would leave out the bright ones, and bias the rest.
///
/// # Panics
/// If the images differ in size.
#[must_use]
pub fn sums_z(a: Estimate<'_>, b: Estimate<'_>) -> f64 {
    let lanes = a.mean.len();
    assert!([a.variance.len(), b.mean.len(), b.variance.len()] == [lanes; 3]);
    let channel = lanes / 3;
    let sum = |values: &[f32], c: usize| -> f64 {
        values[c * channel..(c + 1) * channel].iter().map(|&x| f64::from(x)).sum()
    };
    (0..3)
        .map(|c| {
            let variance = sum(a.variance, c) + sum(b.variance, c);
            (sum(a.mean, c) - sum(b.mean, c)).abs() / variance.sqrt()
        })
        .fold(0.0, f64::max)
}

/// z with P(|Z| > z) = p for a standard normal Z: bisection on the tail, which
/// the continued fraction of Mills' ratio gives.
fn two_sided_quantile(p: f64) -> f64 {
    let tail = |z: f64| {
        let density = (-z * z / 2.0).exp() / (2.0 * std::f64::consts::PI).sqrt();
        let mut fraction = z;
        for k in (1..=200).rev() {
            fraction = z + f64::from(k) / fraction;
        }
        2.0 * density / fraction
    };
    let (mut low, mut high) = (0.1, 40.0);
    for _ in 0..100 {
        let middle = (low + high) / 2.0;
        if tail(middle) > p { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_match_tables() {
        for (p, z) in [(0.05, 1.959_964), (0.01, 2.575_829), (1e-6, 4.891_638)] {
            assert!((two_sided_quantile(p) - z).abs() < 1e-5, "{p}");
        }
    }

    #[test]
    fn differences_are_found() {
        let variance = [1e-6_f32; 1000];
        let mean: Vec<f32> = (0..1000).map(|i| 0.5 + 1e-3 * (i as f32).sin()).collect();
        let flat = [0.5_f32; 1000];
        let same = |mean: &[f32], variance: &[f32]| {
            compare(Estimate { mean, variance }, Estimate { mean: &flat, variance: &[1e-6; 1000] })
                .same()
        };
        assert!(same(&mean, &variance));
        // One lane by 8 standard errors.
        let mut one = mean.clone();
        one[7] += 8.0 * 1.414e-3;
        assert!(!same(&one, &variance));
        // All lanes by 0.3 standard errors.
        let all: Vec<f32> = mean.iter().map(|x| x + 0.3 * 1.414e-3).collect();
        assert!(!same(&all, &variance));
        // A lane without variance on either side.
        let exact = |mean| {
            compare(
                Estimate { mean: &[mean], variance: &[0.0] },
                Estimate { mean: &[0.0], variance: &[0.0] },
            )
            .same()
        };
        assert!(exact(0.0) && !exact(1e-6));
    }
}
