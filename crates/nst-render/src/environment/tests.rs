use std::{f64::consts::PI, sync::Arc};

use glam::{DVec3, Vec2};

use super::{importance::EnvironmentSampler, *};
use crate::{Sampler, SamplerKind, color::luminance};

fn sky(size: [u32; 2], texel: impl Fn(u32, u32) -> [f32; 3]) -> Environment {
    let [width, height] = size;
    let texels = (0..width * height).map(|i| texel(i % width, i / width)).collect();
    let image = Texture::new(size, texels).expect("a texel per pixel");
    Environment { radiance: Vec3A::ONE, image: Some(Arc::new(image)), ..Default::default() }
}

/// A few bright texels on a dim sky, one row black.
fn patchy() -> Environment {
    let texel = |x: u32, y: u32| match (x, y) {
        (_, 1) => [0.0; 3],
        (3, 2) => [50.0, 40.0, 30.0],
        (2, 5) => [5.0; 3],
        _ => [0.5, 0.6, 0.7],
    };
    Environment { radiance: Vec3A::new(1.0, 0.5, 2.0), rotation: 77.0, ..sky([8, 8], texel) }
}

/// One texel of `sun`, all others 1.
fn sun(size: [u32; 2], place: (u32, u32), sun: f32) -> Environment {
    sky(size, |x, y| if (x, y) == place { [sun; 3] } else { [1.0; 3] })
}

/// Skies of all shapes: small ones, black rows, lone texels at the seam, at a pole and beside one.
fn skies() -> Vec<(&'static str, Environment)> {
    let black = |x, y, place| if (x, y) == place { [1.0; 3] } else { [0.0; 3] };
    vec![
        ("patchy", patchy()),
        ("one texel", sky([1, 1], |_, _| [0.5; 3])),
        ("a gradient", sky([1, 16], |_, y| [0.1 + y as f32; 3])),
        ("two rows", sky([1, 2], |_, y| [3.0 * (1 - y) as f32; 3])),
        ("two columns", Environment { rotation: -30.0, ..sky([2, 1], |x, _| [x as f32; 3]) }),
        ("a lone texel", sky([40, 9], |x, y| black(x, y, (33, 4)))),
        ("at the seam", sky([33, 4], |x, y| black(x, y, (32, 1)))),
        ("at the pole", sky([5, 6], |x, y| black(x, y, (2, 0)))),
        ("beside the pole", sky([5, 6], |x, y| black(x, y, (2, 1)))),
        ("a sun", sun([64, 32], (0, 9), 1e6)),
    ]
}

fn direction(theta: f64, phi: f64) -> Vec3A {
    DVec3::new(phi.sin() * theta.sin(), theta.cos(), -phi.cos() * theta.sin()).as_vec3a()
}

/// ∫ f dω over the part of the sphere between two half columns and half rows of an image,
/// by the midpoints of 8 × 8 parts: f is smooth between centres and edges of texels.
fn integral(sky: &Environment, [i, j]: [u32; 2], f: &dyn Fn(Vec3A) -> f64) -> f64 {
    const PARTS: u32 = 8;
    let [width, height] = sky.image.as_ref().expect("an image").size();
    let count = |n: u32| f64::from(2 * n * PARTS);
    let mut sum = 0.0;
    for (p, q) in (0..PARTS * PARTS).map(|n| (i * PARTS + n % PARTS, j * PARTS + n / PARTS)) {
        let [low, high] = [q, q + 1].map(|q| f64::from(q) / count(height) * PI);
        let phi = (f64::from(p) + 0.5) / count(width) * 2.0 * PI;
        let phi = phi - f64::from(sky.rotation).to_radians();
        sum += f(direction((low + high) / 2.0, phi)) * (low.cos() - high.cos());
    }
    sum * 2.0 * PI / count(width)
}

/// All pairs of half columns and half rows.
fn halves(sky: &Environment) -> impl Iterator<Item = [u32; 2]> {
    let [width, height] = sky.image.as_ref().expect("an image").size().map(|n| 2 * n);
    (0..width * height).map(move |i| [i % width, i / width])
}

fn luminance_of(sky: &Environment) -> impl Fn(Vec3A) -> f64 {
    |direction| f64::from(luminance(sky.radiance(direction)))
}

/// The first `count` samples.
fn samples(sampler: &EnvironmentSampler, count: u32) -> impl Iterator<Item = Vec3A> {
    let random = Sampler::new(SamplerKind::Random, 1);
    (0..count).map(move |i| sampler.sample(random.stream(0, i).next_2d()))
}

/// The mean of f/p over samples, in standard errors from ∫ f dω.
fn z(
    sampler: &EnvironmentSampler,
    pdf: impl Fn(Vec3A) -> f64,
    f: &dyn Fn(Vec3A) -> f64,
    exact: f64,
) -> f64 {
    let (mut sum, mut squares) = (0.0, 0.0);
    const COUNT: u32 = 100_000;
    for direction in samples(sampler, COUNT) {
        let value = f(direction) / pdf(direction);
        sum += value;
        squares += value * value;
    }
    let n = f64::from(COUNT);
    let error = ((squares / n - (sum / n).powi(2)) / n).sqrt();
    // Samples that are all equal are off by rounding: f32 has seven digits.
    (sum / n - exact).abs() / error.max(1e-6 * exact)
}

/// Between its midpoints, a function that is linear in both directions times sin θ is off
/// by (π/128)² / 24 at most in the images of one row; a density that follows a wrong
/// interpolation would be off by per cents.
const QUADRATURE: f64 = 1e-3;

#[test]
fn densities_integrate_to_one() {
    for (name, sky) in skies() {
        let sampler = EnvironmentSampler::new(&sky).expect("it is not black");
        let pdf = |direction| f64::from(sampler.pdf(direction));
        let sum: f64 = halves(&sky).map(|half| integral(&sky, half, &pdf)).sum();
        assert!((sum - 1.0).abs() < QUADRATURE, "{name}: {sum}");
        let luminance = luminance_of(&sky);
        let sum: f64 = halves(&sky).map(|half| integral(&sky, half, &luminance)).sum();
        let mean = sampler.mean_luminance() * 4.0 * PI;
        assert!((sum / mean - 1.0).abs() < QUADRATURE, "{name}: {sum}, not {mean}");
    }
}

/// f varies over the sphere: its mean is wrong where samples lie elsewhere than the density
/// says. One that is wrong by a tenth from pole to pole is seen.
#[test]
fn sampling_is_unbiased() {
    for (name, sky) in skies() {
        let sampler = EnvironmentSampler::new(&sky).expect("it is not black");
        let radiance = luminance_of(&sky);
        let f = |wi: Vec3A| radiance(wi) * f64::from(2.0 + wi.x + 0.5 * wi.y - 0.3 * wi.z);
        let exact: f64 = halves(&sky).map(|half| integral(&sky, half, &f)).sum();
        let pdf = |wi: Vec3A| f64::from(sampler.pdf(wi));
        let right = z(&sampler, pdf, &f, exact);
        assert!(right < 4.0, "{name}: {right}");
        let wrong = |wi: Vec3A| pdf(wi) * (1.0 + 0.1 * f64::from(0.5 - wi.y));
        let wrong = z(&sampler, wrong, &f, exact);
        assert!(wrong > 4.0, "{name}: {wrong}");
    }
}

/// χ² over half columns and half rows: samples fall where the density says they do.
#[test]
fn samples_follow_the_density() {
    const COUNT: u32 = 200_000;
    for (name, sky) in skies() {
        let sampler = EnvironmentSampler::new(&sky).expect("it is not black");
        let [width, height] = sampler_size(&sky);
        let mut found = vec![0.0; (4 * width * height) as usize];
        for wi in samples(&sampler, COUNT) {
            assert!((wi.length() - 1.0).abs() < 1e-6, "{name}: {wi}");
            let turn = wi.x.atan2(-wi.z) / std::f32::consts::TAU + sky.rotation / 360.0;
            let theta = wi.x.hypot(wi.z).atan2(wi.y) / std::f32::consts::PI;
            let i = ((turn - turn.floor()) * (2 * width) as f32) as u32;
            let j = (theta * (2 * height) as f32) as u32;
            let at = j.min(2 * height - 1) * 2 * width + i.min(2 * width - 1);
            found[at as usize] += 1.0;
        }
        let chi2 = |pdf: &dyn Fn(Vec3A) -> f64| {
            let (mut chi2, mut cells, mut rare) = (0.0, 0.0, [0.0; 2]);
            for (half, &found) in halves(&sky).zip(&found) {
                let expected = f64::from(COUNT) * integral(&sky, half, pdf);
                // Cells of few samples count as one.
                if expected < 10.0 {
                    rare = [rare[0] + expected, rare[1] + found];
                } else {
                    chi2 += (found - expected).powi(2) / expected;
                    cells += 1.0;
                }
            }
            let [expected, found] = rare;
            chi2 += (found - expected).powi(2) / expected.max(10.0);
            // In standard deviations of χ² from its mean.
            (chi2 - cells) / (2.0_f64 * cells).sqrt()
        };
        let right = chi2(&|wi| f64::from(sampler.pdf(wi)));
        assert!(right < 5.0, "{name}: {right}");
        let wrong = chi2(&|wi| f64::from(sampler.pdf(wi) * (1.0 + 0.2 * wi.y)));
        assert!(wrong > 5.0, "{name}: {wrong}");
    }
}

fn sampler_size(sky: &Environment) -> [u32; 2] {
    sky.image.as_ref().expect("an image").size()
}

/// L/p is the constant 2π T / W times M/P, which is within 2/3 and 2, and almost 1 far
/// from the poles. A density that is constant over texels makes it 1/4 to 1e6 around a sun.
#[test]
fn luminance_over_density_is_almost_constant() {
    for (name, sky) in skies() {
        let sampler = EnvironmentSampler::new(&sky).expect("it is not black");
        let luminance = luminance_of(&sky);
        let exact = sampler.mean_luminance() * 4.0 * PI;
        let mut squares = 0.0;
        const COUNT: u32 = 10_000;
        for wi in samples(&sampler, COUNT) {
            let ratio = luminance(wi) / f64::from(sampler.pdf(wi)) / exact;
            // M/P and its mean are both within 2/3 and 2.
            assert!((1.0 / 3.0..3.0).contains(&ratio), "{name}: {ratio} at {wi}");
            squares += (ratio - 1.0).powi(2) / f64::from(COUNT);
        }
        let deviation = squares.sqrt();
        // With a row or two, caps are large and M = P everywhere or almost; with more, a strip
        // beside a cap is a part of the sphere that shrinks.
        let most = match name {
            "one texel" | "two columns" => 1e-5,
            "a sun" => 0.03,
            _ => 0.2,
        };
        assert!(deviation < most, "{name}: {deviation}");
    }
}

/// After a texel of 10⁶, sums in f32 would have steps of 1/16, and dim texels of 0.01 would
/// never be found. Here each column is found within 10⁻⁹ of its share.
#[test]
fn dim_texels_beside_a_bright_one_keep_their_shares() {
    let sky = sky([8192, 2], |x, _| if x == 100 { [1e6; 3] } else { [0.01; 3] });
    let sampler = EnvironmentSampler::new(&sky).expect("it is not black");
    let weight = |x: u32| f64::from(luminance(Vec3A::splat(if x == 100 { 1e6 } else { 0.01 })));
    let sum: f64 = (0..8192).map(weight).sum();
    let mut before = 0.0;
    for x in 0..8192 {
        // The middle of the integral between the centres of this column and the next.
        let (left, right) = (weight(x), weight((x + 1) % 8192));
        let u = (before + (left + right) / 4.0) / sum;
        before += (left + right) / 2.0;
        let found = sampler.column(1, 0.3, u);
        assert_eq!(found.floor(), f64::from(x), "{found}");
        if left == right {
            assert!((found - f64::from(x) - 0.5).abs() < 1e-4, "{found}");
        }
    }
}

#[test]
fn orientation_and_rotation() {
    let close = |direction: Vec3A, rotation: f32, u: f32, v: f32| {
        let place = Place::of(direction, rotation, [400, 200]);
        let x = (place.columns[0] as f32 + place.across + 0.5) / 400.0 % 1.0;
        let y = (place.strip as f32 - 0.5 + place.down) / 200.0;
        assert!((x - u).abs() < 1e-6 && (y - v).abs() < 1e-6, "{direction}: {x} {y}");
    };
    close(Vec3A::NEG_Z, 0.0, 0.0, 0.5);
    close(Vec3A::X, 0.0, 0.25, 0.5);
    close(Vec3A::Z, 0.0, 0.5, 0.5);
    close(Vec3A::NEG_X, 0.0, 0.75, 0.5);
    close(Vec3A::new(0.0, 0.8, 0.6), 0.0, 0.5, 0.204_832_77);
    // Turned from +z towards +x, the middle of the image is at +x, and its left edge at −x.
    close(Vec3A::X, 90.0, 0.5, 0.5);
    close(Vec3A::NEG_X, 90.0, 0.0, 0.5);
    close(Vec3A::Z, -90.0, 0.25, 0.5);
    let rotated = glam::Quat::from_rotation_y(0.7) * Vec3A::new(0.36, 0.48, 0.8);
    let [before, after] = [(rotated, 0.7_f32.to_degrees()), (Vec3A::new(0.36, 0.48, 0.8), 0.0)]
        .map(|(direction, rotation)| Place::of(direction, rotation, [400, 200]));
    assert_eq!((before.columns, before.rows), (after.columns, after.rows));
}

/// Rows end at the poles; columns go round.
#[test]
fn poles_and_the_seam() {
    let sky = sky([4, 3], |x, y| [x as f32, y as f32, 10.0 * y as f32 + x as f32]);
    let green = |direction| sky.radiance(direction).y;
    assert_eq!([green(Vec3A::Y), green(Vec3A::NEG_Y)], [0.0, 2.0]);
    // Below the centres of the first row, at 30°, and in the middle of the second.
    assert_eq!(green(direction(0.5, 1.0)), 0.0);
    assert!((green(direction(PI / 3.0, 1.0)) - 0.5).abs() < 1e-6);
    // Half way between the last column, 3, and the first one, 0.
    assert!((sky.radiance(Vec3A::NEG_Z).x - 1.5).abs() < 1e-6);
    // The irradiance over π that two rows of 3 and 0 give a floor is ∫ L sin 2θ dθ, with
    // L = 3 to θ = π/4, and then 4.5 − 6 θ/π to π/2: 3/2 + 9/4 − (6/π) (π/4 − 1/4).
    let two = self::sky([1, 2], |_, y| [3.0 * (1 - y) as f32; 3]);
    let cosine = |wi: Vec3A| f64::from(two.radiance(wi).x) * f64::from(wi.y.max(0.0)) / PI;
    let sum: f64 = halves(&two).map(|half| integral(&two, half, &cosine)).sum();
    // Midpoints are off by 1e-3 here; rows that repeat would give 2.455.
    assert!((sum - 2.727_46).abs() < 5e-3, "{sum}");
}

#[test]
fn a_black_image_is_never_sampled() {
    assert!(EnvironmentSampler::new(&sky([4, 2], |_, _| [0.0; 3])).is_none());
    let bright = sky([4, 2], |_, _| [1.0; 3]);
    assert!(EnvironmentSampler::new(&bright).is_some());
    let unlit = Environment { radiance: Vec3A::ZERO, ..bright };
    assert!(EnvironmentSampler::new(&unlit).is_none());
}

/// Both ends of the random numbers, and directions along the axes.
#[test]
fn samples_are_directions_with_a_density() {
    let last = 1.0_f32.next_down();
    for (name, sky) in skies() {
        let sampler = EnvironmentSampler::new(&sky).expect("it is not black");
        for (x, y) in [(0.0, 0.0), (last, last), (0.0, last), (last, 0.0), (0.5, 0.5)] {
            let wi = sampler.sample(Vec2::new(x, y));
            assert!((wi.length() - 1.0).abs() < 1e-6, "{name}: {wi}");
        }
        for axis in [Vec3A::X, Vec3A::Y, Vec3A::Z] {
            for wi in [axis, -axis] {
                let pdf = sampler.pdf(wi);
                assert!(pdf.is_finite() && pdf >= 0.0, "{name}: {pdf} at {wi}");
                assert_eq!(pdf > 0.0, sky.radiance(wi) != Vec3A::ZERO, "{name}: {wi}");
            }
        }
    }
}
