//! Samples directions to an image in proportion to its luminance, as it is interpolated.
//!
//! The luminance L(x, θ) is bilinear between the centres of texels, in columns x and the
//! angle θ from +y. First a strip between two rows of centres is chosen, and within it
//! z = cos θ, by a density that goes linearly in z from the sum of the upper row, a, to that
//! of the lower one, b. Then x is chosen in proportion to L(x, θ), exactly: its integral over
//! x is the interpolation M(θ) of a and b. With P(z), the interpolation in z, the density
//! with respect to solid angle is
//!
//! ```text
//! p(ω) = L(x, θ) P(z) / M(θ) · W / (2π T)        T = ∫ P dz,  W columns
//! ```
//!
//! P / M is 1 in the polar caps and where a = b, within 1/2 and 3/2 in the strips next to
//! the caps, and 1 + O(1 / rows) far from them. So L / p is almost constant.

use std::{f64::consts::PI, sync::Arc};

use glam::{Vec2, Vec3A};
use rayon::prelude::*;

use super::{Place, adjacent_rows, rows};
use crate::{Environment, Texture, color::luminance};

/// How many columns share an entry of the tables: few entries fit the caches, and the
/// texels of 16 columns are three cache lines of each row, which are walked along.
const BLOCK: usize = 16;

/// The sampling tables of an image. A uniform environment needs none: sampling the BSDF
/// finds it as often as it should.
pub(crate) struct EnvironmentSampler {
    image: Arc<Texture>,
    /// [`Environment::radiance`]
    tint: Vec3A,
    /// [`Environment::rotation`]
    rotation: f32,
    /// By row, for each block of columns: the integral of the luminance over x from the
    /// centre of column 0 to the block's end. That of a row's last block is the row's sum.
    blocks: Vec<f64>,
    /// By strip: where it begins and ends, as cos θ.
    edges: Vec<f64>,
    /// By strip: the integral of P over z, of all strips down to its end.
    cumulative: Vec<f64>,
}

impl EnvironmentSampler {
    /// `None` without an image, and for a black one.
    pub(crate) fn new(environment: &Environment) -> Option<Self> {
        let image = environment.image.clone()?;
        let [width, height] = image.size().map(|n| n as usize);
        let tint = environment.radiance;
        let mut blocks = vec![0.0; height * width.div_ceil(BLOCK)];
        blocks
            .par_chunks_exact_mut(width.div_ceil(BLOCK))
            .zip_eq(rows(&image).collect::<Vec<_>>())
            .for_each(|(blocks, row)| integrate(row, tint, blocks));
        let mut sampler = Self {
            image,
            tint,
            rotation: environment.rotation,
            blocks,
            edges: (0..height + 2).map(|edge| edge_angle(edge, height).cos()).collect(),
            cumulative: Vec::new(),
        };
        let mut total = 0.0;
        let strips = (0..=height).map(|strip| {
            let [a, b] = sampler.sums(strip);
            total += (sampler.edges[strip] - sampler.edges[strip + 1]) * (a + b) / 2.0;
            total
        });
        sampler.cumulative = strips.collect();
        (total > 0.0).then_some(sampler)
    }

    /// The mean luminance over the sphere.
    pub(crate) fn mean_luminance(&self) -> f64 {
        let [width, height] = self.size();
        let strip = |strip: usize| {
            let [a, b] = self.sums(strip);
            let [top, bottom] = [strip, strip + 1].map(|edge| edge_angle(edge, height));
            // ∫ sin θ dθ, and that of sin θ times what goes from 0 to 1.
            let [high, low] = [self.edges[strip], self.edges[strip + 1]];
            a * (high - low) + (b - a) * ((bottom.sin() - top.sin()) / (bottom - top) - low)
        };
        (0..=height).map(strip).sum::<f64>() / (2.0 * width as f64)
    }

    /// A unit direction, in proportion to the luminance that arrives from there.
    pub(crate) fn sample(&self, u: Vec2) -> Vec3A {
        let [width, height] = self.size();
        let target = f64::from(u.y) * self.total();
        let strip = self.cumulative.partition_point(|&end| end <= target).min(height);
        let before = if strip == 0 { 0.0 } else { self.cumulative[strip - 1] };
        let [high, low] = [self.edges[strip], self.edges[strip + 1]];
        let part = where_integral_is(self.sums(strip), (target - before) / (high - low));
        let z = high - part * (high - low);
        let sin_theta = ((1.0 - z) * (1.0 + z)).sqrt();
        let top = strip as f64 - 0.5;
        let down = (sin_theta.atan2(z) / PI * height as f64 - top).clamp(0.0, 1.0);
        let x = self.column(strip, down, f64::from(u.x)) + 0.5;
        let phi = x / width as f64 * 2.0 * PI - f64::from(self.rotation).to_radians();
        let (sin_phi, cos_phi) = phi.sin_cos();
        Vec3A::new((sin_phi * sin_theta) as f32, z as f32, (-cos_phi * sin_theta) as f32)
    }

    /// The density of [`Self::sample`] with respect to solid angle.
    pub(crate) fn pdf(&self, direction: Vec3A) -> f32 {
        let [width, _] = self.size();
        let place = Place::of(direction, self.rotation, self.image.size());
        let luminance = f64::from(luminance(self.tint * place.color(self.image.texels())));
        let sums = self.sums(place.strip);
        let [high, low] = [self.edges[place.strip], self.edges[place.strip + 1]];
        let part = (high - f64::from(place.theta).cos()) / (high - low);
        let correction = mix(sums, part.clamp(0.0, 1.0)) / mix(sums, f64::from(place.down));
        let pdf = luminance * correction * width as f64 / (2.0 * PI * self.total());
        // Not a number where all is black.
        if pdf > 0.0 { pdf as f32 } else { 0.0 }
    }

    /// How far to the right of column 0's centre, in columns: in proportion to the luminance
    /// between the two rows of a strip.
    pub(super) fn column(&self, strip: usize, down: f64, u: f64) -> f64 {
        let [width, height] = self.size();
        let per_row = width.div_ceil(BLOCK);
        let [top, bottom] = adjacent_rows(strip, height);
        let end = |block| mix([top, bottom].map(|row| self.blocks[row * per_row + block]), down);
        let target = u * end(per_row - 1);
        let (mut block, mut beyond) = (0, per_row - 1);
        while block < beyond {
            let middle = usize::midpoint(block, beyond);
            if end(middle) <= target { block = middle + 1 } else { beyond = middle }
        }
        let mut rest = if block == 0 { target } else { target - end(block - 1) };
        let texels = [top, bottom].map(|row| &self.image.texels()[row * width..][..width]);
        let luminance = |column: usize| mix(texels.map(|row| weight(row[column], self.tint)), down);
        let last = ((block + 1) * BLOCK).min(width) - 1;
        let mut column = block * BLOCK;
        let mut left = luminance(column);
        loop {
            let right = luminance(if column + 1 == width { 0 } else { column + 1 });
            let integral = (left + right) / 2.0;
            if rest < integral || column == last {
                return column as f64 + where_integral_is([left, right], rest);
            }
            rest -= integral;
            left = right;
            column += 1;
        }
    }

    /// The sums over the rows above and below a strip: the integrals of the luminance over x.
    fn sums(&self, strip: usize) -> [f64; 2] {
        let [width, height] = self.size();
        let per_row = width.div_ceil(BLOCK);
        adjacent_rows(strip, height).map(|row| self.blocks[(row + 1) * per_row - 1])
    }

    fn size(&self) -> [usize; 2] {
        self.image.size().map(|n| n as usize)
    }

    fn total(&self) -> f64 {
        *self.cumulative.last().expect("an image has rows")
    }
}

/// The angle from +y where a strip begins: 0, the centres of all rows, and π.
fn edge_angle(edge: usize, height: usize) -> f64 {
    (edge as f64 - 0.5).clamp(0.0, height as f64) / height as f64 * PI
}

/// What a texel counts.
fn weight(texel: [f32; 3], tint: Vec3A) -> f64 {
    f64::from(luminance(tint * Vec3A::from(texel)))
}

/// Fills a row's part of [`EnvironmentSampler::blocks`].
fn integrate(row: &[[f32; 3]], tint: Vec3A, blocks: &mut [f64]) {
    let (mut left, mut sum) = (weight(row[0], tint), 0.0);
    for (number, block) in (1..).zip(blocks) {
        let from = (number - 1) * BLOCK + 1;
        for column in from..(from + BLOCK).min(row.len() + 1) {
            let right = weight(row[if column == row.len() { 0 } else { column }], tint);
            sum += (left + right) / 2.0;
            left = right;
        }
        *block = sum;
    }
}

fn mix([a, b]: [f64; 2], part: f64) -> f64 {
    a + (b - a) * part
}

/// Where the integral of what goes from `a` at 0 to `b` at 1 reaches a value.
fn where_integral_is([a, b]: [f64; 2], value: f64) -> f64 {
    let root = (a * a + 2.0 * (b - a) * value).max(0.0).sqrt();
    let part = 2.0 * value / (a + root);
    // Not a number where all is 0.
    if part > 0.0 { part.min(1.0) } else { 0.0 }
}
