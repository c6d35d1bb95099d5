//! Tests of all distributions through [`Bsdf`].

use std::{
    f32::consts::{FRAC_1_PI, PI},
    sync::Arc,
};

use glam::{Vec2, Vec3A};

use super::{
    Bsdf, Frame, Prepared, PreparedDisney,
    chi2::{Lens, QUADRATURE_ERROR, assert_follows, follows},
    test_data::{parameter_grid, polar, random, random_direction},
};
use crate::{Disney, Material, SampleStream, Scattering, Texture};

const COUNT: u32 = 20_000;
const COLOR: Vec3A = Vec3A::new(0.9, 0.5, 0.2);

fn material(color: Vec3A, scattering: Scattering) -> Material {
    Material { color, scattering, ..Material::default() }
}

fn disney(parameters: Disney) -> Prepared {
    Prepared::Disney(Box::new(PreparedDisney::unscaled(&parameters)))
}

fn directions(bsdf: &Bsdf, wo: Vec3A, stream: &mut SampleStream) -> Vec<Option<Vec3A>> {
    let mut draw = || bsdf.sample(wo, stream.next_1d(), stream.next_2d());
    (0..COUNT).map(|_| draw().map(|sample| sample.wi)).collect()
}

/// χ²; and that the density falls short of 1 by what is lost below the horizon is
/// part of it, as lost samples have a cell of their own.
#[test]
fn samples_follow_the_density() {
    let mut stream = random(1);
    let mut prepared: Vec<_> = parameter_grid().into_iter().map(disney).collect();
    prepared.push(Prepared::Lambert);
    for (i, prepared) in prepared.iter().enumerate() {
        let bsdf = prepared.at(COLOR);
        for (theta, phi) in [(0.0, 0.0), (35.0, 70.0), (70.0, 200.0), (85.0, 10.0)] {
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let wo = polar(theta, phi) * Vec3A::new(1.0, 1.0, side);
            let lens = Lens::half(wo);
            let total = lens.integral(|wi| bsdf.pdf(wo, wi));
            assert!(total < 1.0 + QUADRATURE_ERROR, "{prepared:?}, θ = {theta}°: ∫ pdf = {total}");
            let samples = directions(&bsdf, wo, &mut stream);
            let what = format!("{prepared:?}, θ = {theta}°");
            assert_follows(&lens, |wi| bsdf.pdf(wo, wi), &samples, &what);
        }
    }
}

#[test]
fn densities_of_slightly_different_materials_are_rejected() {
    let mut stream = random(2);
    let wo = polar(40.0, 30.0);
    for metallic in [0.5, 1.0] {
        let parameters = Disney { metallic, roughness: 0.4, anisotropic: 0.5, ..Disney::default() };
        let truth = disney(parameters);
        let samples = directions(&truth.at(COLOR), wo, &mut stream);
        let accepts = |parameters| {
            let bsdf = disney(parameters);
            follows(&Lens::half(wo), |wi| bsdf.at(COLOR).pdf(wo, wi), &samples)
        };
        assert!(accepts(parameters));
        assert!(!accepts(Disney { roughness: 0.44, ..parameters }));
        assert!(!accepts(Disney { anisotropic: 0.0, ..parameters }));
        assert!(!accepts(Disney { metallic: 0.75, ..parameters }));
    }
    let samples = directions(&Prepared::Lambert.at(COLOR), wo, &mut stream);
    let uniform = |wi: Vec3A| if wi.z > 0.0 { 0.5 * FRAC_1_PI } else { 0.0 };
    assert!(!follows(&Lens::half(wo), uniform, &samples));
}

/// The weight is f cos / pdf, and what `sample` says of the density is what `pdf`
/// says; tolerance: rounding. Weights are bounded, so that no lobe makes fireflies.
#[test]
fn samples_weights_and_densities_agree() {
    let mut stream = random(3);
    let mut prepared: Vec<_> = parameter_grid()
        .into_iter()
        .map(|d| Prepared::new(&material(COLOR, Scattering::Disney(d))))
        .collect();
    prepared.push(Prepared::Lambert);
    for (i, prepared) in prepared.iter().enumerate() {
        let bsdf = prepared.at(if i % 3 == 0 { 0.01 * COLOR } else { COLOR });
        for theta in [0.0, 50.0, 85.0, 89.99, 120.0, 179.0] {
            let wo = polar(theta, 60.0);
            for _ in 0..500 {
                let (u, u2) = (stream.next_1d(), stream.next_2d());
                let Some(sample) = bsdf.sample(wo, u, u2) else { continue };
                assert!(sample.wi.is_normalized() && sample.wi.z * wo.z > 0.0 && !sample.delta);
                let (value, pdf) = (bsdf.eval(wo, sample.wi), bsdf.pdf(wo, sample.wi));
                assert_eq!((value, pdf), bsdf.eval_pdf(wo, sample.wi));
                assert!((pdf / sample.pdf - 1.0).abs() < 1e-5, "{prepared:?} {sample:?} {pdf}");
                let difference = (sample.weight * sample.pdf - value).abs().max_element();
                assert!(difference <= 1e-5 * value.max_element(), "{prepared:?} {sample:?}");
                assert!(
                    sample.weight.cmpge(Vec3A::ZERO).all() && sample.weight.max_element() < 4.0,
                    "{prepared:?}, θ = {theta}°: {sample:?}"
                );
            }
        }
    }
}

/// f(wo, wi) = f(wi, wo), with the energy scale; nothing passes through.
#[test]
fn lambert_and_disney_are_reciprocal() {
    let mut stream = random(4);
    let mut prepared: Vec<_> = parameter_grid()
        .into_iter()
        .map(|d| Prepared::new(&material(COLOR, Scattering::Disney(d))))
        .collect();
    prepared.push(Prepared::Lambert);
    for prepared in &prepared {
        let bsdf = prepared.at(COLOR);
        for _ in 0..200 {
            let (a, b) = (random_direction(&mut stream), random_direction(&mut stream));
            let there = bsdf.eval(a, b) / b.z.abs();
            let back = bsdf.eval(b, a) / a.z.abs();
            let tolerance = 1e-5 * there.max_element();
            assert!(there.abs_diff_eq(back, tolerance), "{prepared:?} {a} {b}: {there} {back}");
            assert_eq!(there == Vec3A::ZERO, a.z * b.z < 0.0);
            // The cosine spoils it, as it should.
            let cosines_differ = (a.z.abs() / b.z.abs() - 1.0).abs() > 1e-3;
            let spoilt = bsdf.eval(a, b).abs_diff_eq(bsdf.eval(b, a), tolerance);
            assert!(!(cosines_differ && spoilt) || there == Vec3A::ZERO);
        }
    }
}

/// ∫ f cos ≤ 1 for white materials, between the nodes of the table and azimuths.
/// Tolerance: that of the quadrature. Without the scale, it fails.
#[test]
fn no_more_light_leaves_than_arrives() {
    let (mut unscaled_excess, mut scaled) = (0.0_f64, 0);
    for (i, parameters) in parameter_grid().into_iter().enumerate() {
        let white = material(Vec3A::ONE, Scattering::Disney(parameters));
        let (prepared, unscaled) = (Prepared::new(&white), disney(parameters));
        for theta in [3.0, 25.0, 48.0, 63.0, 77.0, 84.0, 88.0, 89.7] {
            let wo = polar(theta, 10.0 + 37.0 * i as f32);
            let lens = Lens::half(wo);
            let albedo = |prepared: &Prepared| {
                lens.integral(|wi| prepared.at(Vec3A::ONE).eval(wo, wi).max_element())
            };
            let (ours, disneys) = (albedo(&prepared), albedo(&unscaled));
            assert!(
                ours < 1.0 + QUADRATURE_ERROR,
                "{parameters:?}, θ = {theta}°: {ours}, unscaled {disneys}"
            );
            assert!(ours > 0.0);
            unscaled_excess = unscaled_excess.max(disneys - 1.0);
            scaled += usize::from(disneys > 1.01);
        }
    }
    assert!(unscaled_excess > 0.1 && scaled > 10, "{unscaled_excess} {scaled}");
}

/// At normal incidence, all facets of a metal are seen. Those that tilt by more than
/// 45°, a fraction α²/(1 + α²), reflect into the surface; masking takes about as
/// much again. Lambert reflects its colour.
#[test]
fn white_furnace() {
    for roughness in [0.05, 0.2, 0.35, 0.5_f32] {
        let metal = Disney { metallic: 1.0, roughness, ..Disney::default() };
        let prepared = Prepared::new(&material(Vec3A::ONE, Scattering::Disney(metal)));
        let reflected = |wi| prepared.at(Vec3A::ONE).eval(Vec3A::Z, wi).x;
        let albedo = Lens::half(Vec3A::Z).integral(reflected);
        let alpha2 = f64::from(roughness).powi(4);
        let (least, most) = (1.0 - 3.0 * alpha2, 1.0 - alpha2 / (1.0 + alpha2));
        let bounds = least - QUADRATURE_ERROR..most + QUADRATURE_ERROR;
        assert!(bounds.contains(&albedo), "{roughness}: {albedo} is not within {bounds:?}");
    }
    let lambert = Prepared::Lambert;
    let albedo = Lens::normal().integral(|wi| lambert.at(COLOR).eval(Vec3A::Z, wi).x);
    assert!((albedo - f64::from(COLOR.x)).abs() < 1e-3);
}

/// Textures: the brightest and the most saturated texel are looked at, wherever
/// they are. Black things reflect nothing, and need no sample.
#[test]
fn colours_at_the_limits() {
    let black = Disney { specular: 0.0, ..Disney::default() };
    let prepared = Prepared::new(&material(Vec3A::ZERO, Scattering::Disney(black)));
    assert!(prepared.at(Vec3A::ZERO).sample(Vec3A::Z, 0.5, Vec2::splat(0.5)).is_none());
    assert_eq!(prepared.at(Vec3A::ZERO).eval_pdf(Vec3A::Z, polar(30.0, 0.0)), (Vec3A::ZERO, 0.0));

    let cloth = Disney { sheen: 1.0, sheen_tint: 1.0, roughness: 1.0, ..Disney::default() };
    let texels = vec![[0.5; 3], [0.0, 0.0, 0.3], [1.0; 3], [0.0; 3]];
    let texture = Texture::new([2, 2], texels).expect("four texels");
    let mut textured = material(Vec3A::ONE, Scattering::Disney(cloth));
    textured.color_texture = Some(Arc::new(texture).into());
    let prepared = Prepared::new(&textured);
    for color in [Vec3A::ONE, Vec3A::new(0.0, 0.0, 0.3), Vec3A::new(0.3, 0.3, 0.35), Vec3A::ZERO] {
        for theta in [10.0, 60.0, 85.0] {
            let wo = polar(theta, 0.0);
            let reflected = |wi| prepared.at(color).eval(wo, wi).max_element();
            let albedo = Lens::half(wo).integral(reflected);
            assert!(albedo < 1.0 + QUADRATURE_ERROR, "{color}, θ = {theta}°: {albedo}");
        }
    }
}

#[test]
fn lambert_is_what_it_was() {
    let bsdf = Prepared::Lambert;
    let bsdf = bsdf.at(COLOR);
    let sample = bsdf.sample(Vec3A::NEG_Z, 0.3, Vec2::new(0.25, 0.36)).expect("a sample");
    assert!(sample.wi.abs_diff_eq(Vec3A::new(0.0, 0.6, -0.8), 1e-6));
    assert_eq!(sample.weight, COLOR);
    assert!((sample.pdf - 0.8 / PI).abs() < 1e-6);
    let frame = Frame::new(Vec3A::Y);
    assert!((frame.to_world(sample.wi).y + 0.8).abs() < 1e-6);
    assert!(!bsdf.is_delta());
    let glass = Prepared::new(&material(COLOR, Scattering::Dielectric { ior: 1.5 }));
    assert!(
        glass.at(COLOR).is_delta() && glass.at(COLOR).sample(Vec3A::Z, 0.0, Vec2::ZERO).is_some()
    );
    assert_eq!(glass.at(COLOR).eval_pdf(Vec3A::Z, Vec3A::Z), (Vec3A::ZERO, 0.0));
}
