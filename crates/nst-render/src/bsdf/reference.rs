//! Disney's BRDF as its definition reads, in f64, and as Mitsuba 3 evaluates it.

use std::{f64::consts::PI, fs};

use glam::{DVec3, Vec3A};

use super::{
    PreparedDisney,
    test_data::{parameter_grid, random, random_direction},
};
use crate::{Disney, SampleStream};

/// f · |cos θi| of directions above the surface; [`super::disney`] has the formulas.
fn definition(d: &Disney, color: DVec3, wo: DVec3, wi: DVec3) -> DVec3 {
    let [metallic, roughness, specular, specular_tint, anisotropic] =
        [d.metallic, d.roughness, d.specular, d.specular_tint, d.anisotropic].map(f64::from);
    let [sheen, sheen_tint, clearcoat, gloss] =
        [d.sheen, d.sheen_tint, d.clearcoat, d.clearcoat_gloss].map(f64::from);
    let luminance = color.dot(DVec3::new(0.212_671, 0.715_160, 0.072_169));
    let tint = color / luminance;
    let half = (wo + wi).normalize();
    let cos_d = half.dot(wi);
    let weight = |cos: f64| (1.0 - cos).powi(5);
    let schlick = |normal: DVec3| normal + (DVec3::ONE - normal) * weight(cos_d);

    let r = 2.0 * roughness * cos_d * cos_d;
    let (fo, fi) = (weight(wo.z), weight(wi.z));
    let base = (1.0 - fo / 2.0) * (1.0 - fi / 2.0);
    let retro = r * (fo + fi + fo * fi * (r - 1.0));
    let diffuse = color / PI * (base + retro);
    let sheen = DVec3::ONE.lerp(tint, sheen_tint) * sheen * weight(cos_d);

    let eta = 2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0;
    let (theta_i, theta_t) = (cos_d.acos(), (cos_d.acos().sin() / eta).asin());
    let cosines = |a: f64, b: f64| (a.cos() - eta * b.cos()) / (a.cos() + eta * b.cos());
    let exact = (cosines(theta_i, theta_t).powi(2) + cosines(theta_t, theta_i).powi(2)) / 2.0;
    let normal = tint * ((eta - 1.0) / (eta + 1.0)).powi(2);
    let fresnel = schlick(color) * metallic
        + (1.0 - metallic)
            * (DVec3::splat((1.0 - specular_tint) * exact) + schlick(normal) * specular_tint);
    let aspect = (1.0 - 0.9 * anisotropic).sqrt();
    let alpha_x = (roughness * roughness / aspect).max(0.001);
    let alpha_y = (roughness * roughness * aspect).max(0.001);
    let ellipse = (half.x / alpha_x).powi(2) + (half.y / alpha_y).powi(2) + half.z * half.z;
    let density = 1.0 / (PI * alpha_x * alpha_y * ellipse * ellipse);
    let g1 = |ax: f64, ay: f64, w: DVec3| {
        let tan2 = ((ax * w.x).powi(2) + (ay * w.y).powi(2)) / (w.z * w.z);
        2.0 / (1.0 + (1.0 + tan2).sqrt())
    };
    let g = g1(alpha_x, alpha_y, wo) * g1(alpha_x, alpha_y, wi);
    let specular = fresnel * density * g / (4.0 * wo.z * wi.z);

    let alpha2 = (0.1 + (0.001 - 0.1) * gloss).powi(2);
    let gtr1 = (alpha2 - 1.0) / (PI * alpha2.ln() * (1.0 + (alpha2 - 1.0) * half.z * half.z));
    let g = g1(0.25, 0.25, wo) * g1(0.25, 0.25, wi);
    let coat = clearcoat / 4.0 * (0.04 + 0.96 * weight(cos_d)) * gtr1 * g;
    ((diffuse + sheen) * (1.0 - metallic) + specular + DVec3::splat(coat)) * wi.z
}

/// Two directions above the surface, every other time about mirror images.
fn random_pair(stream: &mut SampleStream, i: u32) -> (Vec3A, Vec3A) {
    let mut above = || random_direction(stream) * Vec3A::new(1.0, 1.0, 0.0);
    let (a, b) = (above(), above());
    let raise = |v: Vec3A| Vec3A::new(v.x, v.y, (1.0 - v.x * v.x - v.y * v.y).max(0.01).sqrt());
    let near = Vec3A::new(-a.x, -a.y, 0.0) + 0.05 * b;
    (raise(a).normalize(), raise(if i.is_multiple_of(2) { b } else { near * 0.95 }).normalize())
}

/// Half vectors of f32 directions are good to some 1e-7, which the narrowest lobes,
/// α = 0.001, turn into some 1e-3 at their flanks.
const TOLERANCE: f64 = 1e-3;

fn agrees(ours: Vec3A, expected: DVec3) -> bool {
    ours.as_dvec3().abs_diff_eq(expected, TOLERANCE * expected.max_element())
}

#[test]
fn disney_equals_its_definition() {
    let mut stream = random(6);
    for d in parameter_grid() {
        let prepared = PreparedDisney::unscaled(&d);
        for i in 0..200 {
            let color = Vec3A::new(stream.next_1d(), stream.next_1d(), stream.next_1d()) + 1e-3;
            let (wo, wi) = random_pair(&mut stream, i);
            let ours = prepared.at(color).eval_pdf(wo, wi).0;
            let exact = |w: Vec3A| w.as_dvec3().normalize();
            let expected = definition(&d, color.as_dvec3(), exact(wo), exact(wi));
            assert!(agrees(ours, expected), "{d:?} {color} {wo} {wi}: {ours} {expected}");
            let wrong = definition(&d, color.as_dvec3() * 1.01, exact(wo), exact(wi));
            let coloured = (wrong / expected).max_element() > 1.0 + 2.0 * TOLERANCE;
            assert!(!coloured || !agrees(ours, wrong));
        }
    }
}

/// `tests/peers/mitsuba_principled.py` writes the table.
#[test]
fn disney_equals_mitsubas() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/reference/principled.csv");
    let table = fs::read_to_string(path).expect("the reference table");
    let (mut rows, mut rejected) = (0, 0);
    for line in table.lines().skip(1) {
        let row: Vec<f32> = line.split(',').map(|x| x.parse().expect("a number")).collect();
        let vector = |at: usize| Vec3A::from_slice(&row[at..at + 3]);
        let d = Disney {
            metallic: row[0],
            roughness: row[1],
            specular: row[2],
            specular_tint: row[3],
            anisotropic: row[4],
            sheen: row[5],
            sheen_tint: row[6],
            clearcoat: row[7],
            clearcoat_gloss: row[8],
        };
        let (color, wo, wi, expected) = (vector(9), vector(12), vector(15), vector(18));
        let ours = |d: Disney| PreparedDisney::unscaled(&d).at(color).eval_pdf(wo, wi).0;
        assert!(agrees(ours(d), expected.as_dvec3()), "{line}: {}", ours(d));
        let wrong = ours(Disney { roughness: d.roughness * 0.9, ..d });
        rejected += usize::from(!agrees(wrong, expected.as_dvec3()));
        rows += 1;
    }
    // Roughness hardly matters to some of the diffuse ones.
    assert!(rows >= 300 && rejected * 10 > rows * 8, "{rejected} of {rows}");
}
