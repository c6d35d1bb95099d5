//! Tests of samples against densities: Pearson's χ² over cells of the sphere.

use std::f64::consts::PI;

use glam::{DVec3, Vec3A};

/// Number of tests that may be run with [`assert_follows`]; Šidák's correction
/// keeps the probability that any of them fails by chance at [`SIGNIFICANCE`].
const TESTS: f64 = 400.0;
const SIGNIFICANCE: f64 = 0.01;

/// Rings around the normal: the first up to this angle, the others in geometric progression.
const INNERMOST: f64 = 1e-4;
const RINGS: usize = 30;
const SECTORS: usize = 16;
/// The largest relative error of this file's integrals.
pub(super) const QUADRATURE_ERROR: f64 = 1e-3;
/// Midpoints per cell, in angle from the normal and around it.
const POINTS: (usize, usize) = (8, 4);

/// Spherical coordinates of directions about the normal, or of the half vectors
/// between them and `wo`; cells are smaller near the normal. In half vectors, a narrow
/// microfacet lobe has about the same shape for any `wo`, and a wide one is as smooth as
/// in directions.
pub(super) struct Lens {
    wo: Option<Vec3A>,
}

impl Lens {
    /// Directions above the surface themselves.
    pub(super) fn normal() -> Self {
        Self { wo: None }
    }

    /// Directions on the side of `wo`, by their half vectors.
    pub(super) fn half(wo: Vec3A) -> Self {
        Self { wo: Some(wo) }
    }

    fn edge(ring: usize) -> f64 {
        if ring == 0 {
            return 0.0;
        }
        INNERMOST * (PI / 2.0 / INNERMOST).powf((ring - 1) as f64 / (RINGS - 1) as f64)
    }

    /// The integral of `f` over solid angle, in each cell.
    fn integrals(&self, f: impl Fn(Vec3A) -> f32) -> Vec<f64> {
        let mut cells = vec![0.0; RINGS * SECTORS];
        let turns = SECTORS * POINTS.1;
        for turn in 0..turns {
            let phi = 2.0 * PI * (turn as f64 + 0.5) / turns as f64;
            let horizon = self.horizon(phi);
            for ring in 0..RINGS {
                let (low, high) = (Self::edge(ring), Self::edge(ring + 1).min(horizon));
                if high <= low {
                    break;
                }
                let step = (high - low) / POINTS.0 as f64;
                let sum: f64 = (0..POINTS.0)
                    .map(|i| {
                        let angle = low + (i as f64 + 0.5) * step;
                        let (w, jacobian) = self.direction(angle, phi);
                        f64::from(f(w)) * jacobian * angle.sin()
                    })
                    .sum();
                cells[ring * SECTORS + turn / POINTS.1] += sum * step * 2.0 * PI / turns as f64;
            }
        }
        cells
    }

    /// The direction with the given coordinates, and its solid angle per solid angle of the coordinates.
    fn direction(&self, angle: f64, phi: f64) -> (Vec3A, f64) {
        let (sin, cos) = angle.sin_cos();
        let w = DVec3::new(sin * phi.cos(), sin * phi.sin(), cos);
        let Some(wo) = self.wo else { return (w.as_vec3a(), 1.0) };
        let side = DVec3::new(1.0, 1.0, f64::from(wo.z.signum()));
        let wo = wo.as_dvec3() * side;
        let cos_d = wo.dot(w);
        ((side * (2.0 * cos_d * w - wo)).as_vec3a().normalize(), 4.0 * cos_d)
    }

    /// The angle where directions meet the surface.
    fn horizon(&self, phi: f64) -> f64 {
        // With the half vector at angle γ, the direction's z is
        // 2 (wo·h) cos γ − wo.z = wo.z cos 2γ + s sin 2γ.
        self.wo.map_or(PI / 2.0, |wo| {
            let s = f64::from(wo.x) * phi.cos() + f64::from(wo.y) * phi.sin();
            (PI / 2.0 + s.atan2(f64::from(wo.z.abs()))) / 2.0
        })
    }

    /// The integral of `f` over the solid angle on one side of the surface.
    pub(super) fn integral(&self, f: impl Fn(Vec3A) -> f32) -> f64 {
        self.integrals(f).iter().sum()
    }

    fn cell(&self, w: Vec3A) -> usize {
        let DVec3 { x, y, z } = w.as_dvec3() + self.wo.unwrap_or_default().as_dvec3();
        let angle = x.hypot(y).atan2(z.abs());
        let ring = (1..RINGS).find(|&ring| angle < Self::edge(ring)).map_or(RINGS - 1, |r| r - 1);
        let turn = y.atan2(x).rem_euclid(2.0 * PI) / (2.0 * PI);
        ring * SECTORS + ((turn * SECTORS as f64) as usize).min(SECTORS - 1)
    }
}

/// The probability that samples with the density `pdf`, with respect to solid angle, fit
/// worse than these do. `None` among them has the probability that `pdf` lacks to 1.
fn p_value(lens: &Lens, pdf: impl Fn(Vec3A) -> f32, samples: &[Option<Vec3A>]) -> f64 {
    let mut expected = lens.integrals(pdf);
    let mut observed = vec![0.0; expected.len() + 1];
    for sample in samples {
        observed[sample.map_or(RINGS * SECTORS, |w| lens.cell(w))] += 1.0;
    }
    expected.push((1.0 - expected.iter().sum::<f64>()).max(0.0));
    expected.iter_mut().for_each(|e| *e *= samples.len() as f64);

    // Cells that expect fewer than 5 are one cell; if that is small too, it joins
    // the smallest of the others.
    let (small, mut large): (Vec<_>, Vec<_>) =
        expected.into_iter().zip(observed).partition(|&(e, _)| e < 5.0);
    let pool = small.iter().fold((0.0, 0.0), |(e, o), s| (e + s.0, o + s.1));
    large.sort_by(|a, b| b.0.total_cmp(&a.0));
    match large.last_mut() {
        Some(smallest) if pool.0 < 5.0 => {
            smallest.0 += pool.0;
            smallest.1 += pool.1;
        }
        _ => large.push(pool),
    }
    let chi2 = large.iter().map(|(e, o)| (o - e).powi(2) / e).sum();
    upper_tail(chi2, large.len() as f64 - 1.0)
}

/// P(χ² > x) for `k` degrees of freedom, by the cube root's normal approximation
/// (Wilson, Hilferty 1931) and an upper bound of the normal tail.
fn upper_tail(x: f64, k: f64) -> f64 {
    if k < 1.0 {
        return 1.0;
    }
    let spread = 2.0 / (9.0 * k);
    let z = ((x / k).cbrt() - (1.0 - spread)) / spread.sqrt();
    if z < 1.0 { 1.0 } else { (-z * z / 2.0).exp() / (z * (2.0 * PI).sqrt()) }
}

fn threshold() -> f64 {
    1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / TESTS)
}

/// Whether `samples` may have the density `pdf`.
pub(super) fn follows(lens: &Lens, pdf: impl Fn(Vec3A) -> f32, samples: &[Option<Vec3A>]) -> bool {
    p_value(lens, pdf, samples) >= threshold()
}

/// Fails unless `samples` may have the density `pdf`.
#[track_caller]
pub(super) fn assert_follows(
    lens: &Lens,
    pdf: impl Fn(Vec3A) -> f32,
    samples: &[Option<Vec3A>],
    what: &str,
) {
    let p = p_value(lens, pdf, samples);
    assert!(p >= threshold(), "{what}: p = {p:e}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::test_data::polar;

    /// 0.9999 quantiles from tables.
    #[test]
    fn tails_are_those_of_tables() {
        for (x, k) in [(113.5, 63.0), (347.7, 255.0), (161.3, 100.0)] {
            let p = upper_tail(x, k);
            assert!((0.9e-4..1.3e-4).contains(&p), "{x}, {k}: {p}");
        }
    }

    /// Closed forms: ∫ cos dω = π, seen from everywhere, and of a bump about the
    /// normal, ∫ exp(−θ²/s²) dω ≈ π s² (1 − s²/6).
    #[test]
    fn integrals_have_their_closed_forms() {
        for theta in [0.0, 45.0, 85.0, 89.9, 130.0] {
            let cosine = Lens::half(polar(theta, 20.0)).integral(|w| w.z.abs()) / PI;
            assert!((cosine - 1.0).abs() < QUADRATURE_ERROR, "{theta}°: {cosine}");
        }
        for s in [0.002, 0.02_f64] {
            let bump = |w: Vec3A| {
                let angle = w.x.hypot(w.y).atan2(w.z);
                (-angle * angle / (s * s) as f32).exp()
            };
            let integral = Lens::normal().integral(bump) / (PI * s * s * (1.0 - s * s / 6.0));
            assert!((integral - 1.0).abs() < QUADRATURE_ERROR, "{s}: {integral}");
        }
    }

    #[test]
    fn samples_where_the_density_is_zero_are_rejected() {
        let lens = Lens::normal();
        let samples = vec![Some(Vec3A::Z); 10_000];
        assert!(!follows(&lens, |w| if w.z < 0.9 { 0.17 } else { 0.0 }, &samples));
    }
}
