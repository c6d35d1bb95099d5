//! Light from outside the scene. If it is an image, its bright parts are sampled more.

use std::f32::consts::PI;

use glam::{Vec2, Vec3A};

use crate::{Environment, Texture, color::luminance};

/// The sampling tables of an image. A uniform environment needs none: sampling the BSDF
/// finds it as often as it should.
pub(crate) struct EnvironmentSampler {
    rows: Table,
    /// By row: the columns.
    columns: Vec<Table>,
    /// The mean luminance over the sphere, of the image alone.
    mean: f32,
}

impl Environment {
    /// The radiance that arrives from the unit direction `towards` it.
    pub(crate) fn radiance(&self, towards: Vec3A) -> Vec3A {
        match &self.image {
            None => self.radiance,
            Some(image) => self.radiance * image.sample(uv(towards)),
        }
    }
}

impl EnvironmentSampler {
    pub(crate) fn new(image: &Texture) -> Self {
        let [width, height] = image.size();
        let weights = image.texels().chunks_exact(width as usize).enumerate().map(|(y, row)| {
            let sine = ((y as f32 + 0.5) / height as f32 * PI).sin();
            row.iter().map(|&texel| luminance(texel.into()) * sine).collect::<Vec<_>>()
        });
        let columns: Vec<_> = weights.map(|row| Table::new(&row)).collect();
        let rows = Table::new(&columns.iter().map(|table| table.total).collect::<Vec<_>>());
        // Σ L sin θ Δθ Δφ / 4π
        let mean = rows.total * PI / (2.0 * width as f32 * height as f32);
        Self { rows, columns, mean }
    }

    /// The mean luminance over the sphere, of the image alone.
    pub(crate) fn mean_luminance(&self) -> f32 {
        self.mean
    }

    /// A unit direction, and its density with respect to solid angle; `None`
    /// for a black image.
    pub(crate) fn sample(&self, u: Vec2) -> Option<(Vec3A, f32)> {
        let (row, dy) = self.rows.sample(u.y)?;
        let (column, dx) = self.columns[row].sample(u.x)?;
        let across = (column as f32 + dx) / self.columns[row].len() as f32;
        let down = (row as f32 + dy) / self.rows.len() as f32;
        let (sin_theta, cos_theta) = (down * PI).sin_cos();
        let (sin_phi, cos_phi) = (across * 2.0 * PI).sin_cos();
        let direction = Vec3A::new(sin_phi * sin_theta, cos_theta, -cos_phi * sin_theta);
        let pdf = self.density(row, column) / sin_theta;
        (pdf.is_finite() && pdf > 0.0).then_some((direction, pdf))
    }

    /// The density of [`Self::sample`] with respect to solid angle.
    pub(crate) fn pdf(&self, direction: Vec3A) -> f32 {
        let Vec2 { x, y } = uv(direction);
        let cell = |at: f32, count: usize| ((at * count as f32) as usize).min(count - 1);
        let row = cell(1.0 - y, self.rows.len());
        let column = cell(x, self.columns[row].len());
        // Exact near the poles, where 1 − y² is not.
        let sin_theta = direction.x.hypot(direction.z);
        let pdf = self.density(row, column) / sin_theta;
        if pdf.is_finite() { pdf } else { 0.0 }
    }

    /// The density of a cell with respect to solid angle, times sin θ.
    fn density(&self, row: usize, column: usize) -> f32 {
        let unit_square = self.rows.density(row) * self.columns[row].density(column);
        unit_square / (2.0 * PI * PI)
    }
}

/// The place in the image that shows what is seen in a direction: u = 0 is −z, u = 1/4 is
/// +x, v = 1 is +y. Mitsuba's `envmap` has the same orientation.
fn uv(direction: Vec3A) -> Vec2 {
    let turn = direction.x.atan2(-direction.z) / (2.0 * PI);
    Vec2::new(turn.rem_euclid(1.0), 1.0 - direction.y.clamp(-1.0, 1.0).acos() / PI)
}

/// A piecewise constant distribution over equal cells of [0, 1].
struct Table {
    /// Cumulative weights, divided by their total.
    cumulative: Vec<f32>,
    total: f32,
}

impl Table {
    fn new(weights: &[f32]) -> Self {
        let total: f64 = weights.iter().copied().map(f64::from).sum();
        let mut sum = 0.0;
        let share = |weight: &f32| {
            sum += f64::from(*weight);
            (sum / total) as f32
        };
        Self { cumulative: weights.iter().map(share).collect(), total: total as f32 }
    }

    fn len(&self) -> usize {
        self.cumulative.len()
    }

    /// A cell, and a uniform position within it; `None` if all weights are zero.
    fn sample(&self, u: f32) -> Option<(usize, f32)> {
        if self.total == 0.0 {
            return None;
        }
        let last = self.len() - 1;
        let cell = self.cumulative.partition_point(|&sum| sum <= u).min(last);
        let (low, high) = (self.below(cell), self.cumulative[cell]);
        Some((cell, ((u - low) / (high - low)).clamp(0.0, 1.0)))
    }

    /// The density with respect to length.
    fn density(&self, cell: usize) -> f32 {
        if self.total == 0.0 {
            return 0.0;
        }
        (self.cumulative[cell] - self.below(cell)) * self.len() as f32
    }

    fn below(&self, cell: usize) -> f32 {
        if cell == 0 { 0.0 } else { self.cumulative[cell - 1] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Sampler, SamplerKind};

    /// A few bright texels on a dim sky, one row black.
    fn sky() -> Texture {
        let texel = |i: usize| match i {
            8..16 => [0.0; 3],
            19 => [50.0, 40.0, 30.0],
            42 => [5.0; 3],
            _ => [0.5, 0.6, 0.7],
        };
        Texture::new([8, 8], (0..64).map(texel).collect()).expect("64 texels")
    }

    /// ∫ L dω by importance sampling equals the sum over texels: constant texels
    /// of solid angle Δφ (cos θ₁ − cos θ₂).
    #[test]
    fn sampling_is_unbiased() {
        let image = sky();
        let sampler = EnvironmentSampler::new(&image);
        let exact: f64 = image
            .texels()
            .iter()
            .enumerate()
            .map(|(i, texel)| {
                let theta = |edge: usize| f64::from(edge as f32) / 8.0 * std::f64::consts::PI;
                let band = theta(i / 8).cos() - theta(i / 8 + 1).cos();
                f64::from(texel[0]) * band * 2.0 * std::f64::consts::PI / 8.0
            })
            .sum();
        let random = Sampler::new(SamplerKind::Random, 1);
        let (mut sum, mut squares) = (0.0, 0.0);
        const COUNT: u32 = 100_000;
        for i in 0..COUNT {
            let u = random.stream(0, i).next_2d();
            let Some((direction, pdf)) = sampler.sample(u) else { continue };
            assert!((direction.length() - 1.0).abs() < 1e-5);
            assert!((sampler.pdf(direction) / pdf - 1.0).abs() < 1e-2, "{direction}: {pdf}");
            let Vec2 { x, y } = uv(direction);
            let cell = ((1.0 - y) * 8.0).min(7.0) as usize * 8 + (x * 8.0).min(7.0) as usize;
            let value = f64::from(image.texels()[cell][0] / pdf);
            sum += value;
            squares += value * value;
        }
        let n = f64::from(COUNT);
        let error = (squares / n - (sum / n).powi(2)).sqrt() / n.sqrt();
        assert!((sum / n - exact).abs() < 4.0 * error, "{} ± {error}, not {exact}", sum / n);
        let mean = f64::from(sampler.mean_luminance()) * 4.0 * std::f64::consts::PI;
        // The luminance of this sky is near its red channel, but not the same.
        assert!((mean / exact - 1.0).abs() < 0.2, "{mean} {exact}");
    }

    #[test]
    fn orientation() {
        let close = |direction, u: f32, v: f32| {
            assert!(uv(direction).distance(Vec2::new(u, v)) < 1e-6, "{direction}");
        };
        close(Vec3A::NEG_Z, 0.0, 0.5);
        close(Vec3A::X, 0.25, 0.5);
        close(Vec3A::Z, 0.5, 0.5);
        close(Vec3A::Y, uv(Vec3A::Y).x, 1.0);
    }

    #[test]
    fn a_black_image_is_never_sampled() {
        let black = Texture::new([4, 2], vec![[0.0; 3]; 8]).expect("eight texels");
        let sampler = EnvironmentSampler::new(&black);
        assert!(sampler.sample(Vec2::splat(0.5)).is_none());
        assert_eq!(sampler.pdf(Vec3A::X), 0.0);
    }
}
