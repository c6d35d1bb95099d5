use super::{planes::threshold, *};
use crate::{Grid, Identity, random::SplitMix64};

pub(crate) const SIZE: [u32; 2] = [37, 29];
const SAMPLES: usize = 16;

/// Samples of a picture: two areas of different brightness with an edge between them, and noise.
pub(crate) fn picture(channels: u32, seed: u64) -> SequenceBatch {
    let [width, height] = SIZE;
    let grid = Grid::new(width, height, channels, 0).expect("a grid");
    let mut random = SplitMix64(seed);
    let mut samples = Vec::new();
    for _ in 0..SAMPLES {
        for lane in 0..grid.lanes() {
            let x = lane % grid.width();
            let level = if x < 15 { 0.2 } else { 2.0 } * (1 + lane / grid.pixels()) as f64;
            samples.push((level * 2.0 * random.uniform()) as f32);
        }
    }
    let mut batch = SequenceBatch::from_samples(grid.lanes(), &samples).expect("a batch");
    batch.set_grid(grid).expect("it fits");
    batch
}

/// The mean of the roots of all samples, `[lane]`.
fn roots(batch: &SequenceBatch) -> Vec<f32> {
    mean_over_folds(&batch.of_folds(Side::OF_FOLDS[1]).expect("folds"), &[0.25; 4])
}

/// Guides that go up and down: three planes, or six.
pub(crate) fn guides(pixels: usize, count: usize) -> Vec<Vec<f32>> {
    let wave = |guide: usize, pixel: usize| ((pixel * (guide + 3)) as f32 * 0.05).sin();
    (0..count).map(|guide| (0..pixels).map(|pixel| wave(guide, pixel)).collect()).collect()
}

/// The variance of every guide of a pixel.
fn guide_variance(pixel: usize) -> f32 {
    (pixel % 3) as f32 * 0.01
}

pub(crate) fn planes_of(batch: &SequenceBatch, guides: &[Vec<f32>]) -> Planes {
    let variances: Vec<f32> = (0..guides.first().map_or(0, Vec::len)).map(guide_variance).collect();
    let variances = &variances;
    let guide = |values| Guide { values, variances, scale: 0.4 };
    let guides: Vec<_> = guides.iter().map(|values| guide(values)).collect();
    let root = roots(batch);
    let means = Means { samples: SAMPLES as f64, mean: batch.last(), root: &root };
    Planes::new(batch.grid().expect("a picture"), &means, &guides)
}

pub(crate) fn filtered(
    batch: &SequenceBatch,
    guides: &[Vec<f32>],
    instructions: Instructions,
) -> Vec<f32> {
    let mut out = vec![f32::NAN; batch.lanes()];
    WelchFilter::new(instructions).run(&planes_of(batch, guides), &mut out);
    out
}

/// The formulas, in f64, pixel by pixel.
fn oracle(batch: &SequenceBatch, guides: &[Vec<f32>]) -> Vec<f64> {
    let grid = batch.grid().expect("a picture");
    let [width, rows] = [grid.width(), grid.rows()].map(|length| length as isize);
    let root = roots(batch);
    let at = |x: isize, y: isize, c: usize| c * grid.pixels() + (y * width + x) as usize;
    let number = |values: &[f32], lane: usize| f64::from(values[lane]);
    let own = |x: isize, y: isize, c: usize| {
        let lane = at(x.clamp(0, width - 1), y.clamp(0, rows - 1), c);
        let variance = number(batch.last(), lane) - number(&root, lane).powi(2);
        variance.max(0.0) / (SAMPLES - 1) as f64
    };
    let variance = |x: isize, y: isize, c: usize| {
        let mut around = 0.0;
        for (j, down) in [1.0, 4.0, 6.0, 4.0, 1.0].into_iter().enumerate() {
            for (i, across) in [1.0, 4.0, 6.0, 4.0, 1.0].into_iter().enumerate() {
                around += down * across / 256.0 * own(x + i as isize - 2, y + j as isize - 2, c);
            }
        }
        own(x, y, c).max(0.5 * around)
    };
    let channels = grid.channels();
    let mut out = vec![0.0; grid.lanes()];
    // One test for three channels; of other numbers, each is for itself.
    let together = if channels == 3 { 3 } else { 1 };
    for y in 0..rows {
        for x in 0..width {
            for first in (0..channels).step_by(together) {
                let mut total = 0.0;
                let mut sums = vec![0.0; together];
                for qy in (y - 10).max(0)..=(y + 10).min(rows - 1) {
                    for qx in (x - 10).max(0)..=(x + 10).min(width - 1) {
                        let r2 = ((qx - x).pow(2) + (qy - y).pow(2)) as f64;
                        let alike = (first..first + together).all(|c| {
                            let d = number(&root, at(x, y, c)) - number(&root, at(qx, qy, c));
                            let noise = variance(x, y, c) + variance(qx, qy, c);
                            d * d <= f64::from(threshold(SAMPLES as f64)) * noise
                        });
                        if r2 > 100.0 || !alike {
                            continue;
                        }
                        let mut differ = 0.0;
                        for guide in guides {
                            let pixels = [at(x, y, 0), at(qx, qy, 0)];
                            let [p, q] = pixels.map(|i| number(guide, i));
                            let [v, w] = pixels.map(|i| f64::from(guide_variance(i)));
                            differ += ((p - q).powi(2) - v - w) / (2.0 * 0.4 * 0.4);
                        }
                        let s = r2 / 50.0 + f64::max(differ, 0.0);
                        let weight = (1.0 - s / 8.0).max(0.0).powi(8);
                        total += weight;
                        for (c, sum) in sums.iter_mut().enumerate() {
                            *sum += weight * number(batch.last(), at(qx, qy, first + c));
                        }
                    }
                }
                for (c, sum) in sums.into_iter().enumerate() {
                    out[at(x, y, first + c)] = sum / total;
                }
            }
        }
    }
    out
}

#[test]
fn the_formulas_hold() {
    for (channels, count) in [(1, 0), (3, 0), (2, 3), (3, 3), (1, 6), (3, 6)] {
        let batch = picture(channels, 5);
        let guides = guides(batch.grid().expect("a picture").pixels(), count);
        let expected = oracle(&batch, &guides);
        let best = filtered(&batch, &guides, Instructions::detect());
        for (lane, (value, expected)) in best.iter().zip(&expected).enumerate() {
            // Sums of some 300 numbers in f32; no test is as close as that to its threshold.
            let error = (f64::from(*value) / expected - 1.0).abs();
            assert!(error < 2e-5, "{channels} channels, {count} guides, lane {lane}: {error}");
        }
        for instructions in Instructions::available() {
            // Products and sums are fused, or are not.
            let others = filtered(&batch, &guides, instructions);
            let near = best.iter().zip(&others).all(|(a, b)| (a / b - 1.0).abs() < 1e-5);
            assert!(near, "{instructions}: more than rounding");
        }
        // The comparison sees a wrong result.
        let plain = batch.last().iter().zip(&expected);
        assert!(plain.filter(|(s, e)| (f64::from(**s) / **e - 1.0).abs() > 0.01).count() > 100);
    }
}

#[test]
fn noise_is_averaged_and_an_edge_is_kept() {
    let batch = picture(3, 7);
    let values = filtered(&batch, &[], Instructions::detect());
    let grid = batch.grid().expect("a picture");
    let mut errors = [0.0; 2];
    for (lane, value) in values.iter().enumerate() {
        let x = lane % grid.width();
        let level = if x < 15 { 0.2 } else { 2.0 } * (1 + lane / grid.pixels()) as f64;
        for (error, estimate) in errors.iter_mut().zip([batch.last()[lane], *value]) {
            *error += (f64::from(estimate) / level - 1.0).powi(2);
        }
        assert!((f64::from(*value) / level - 1.0).abs() < 0.5, "the other side is mixed in");
    }
    // Some hundred pixels count, by the distance: the noise is below a twentieth.
    assert!(errors[1] < 0.05 * errors[0], "{errors:?}");
}

#[test]
fn strips_with_a_halo_give_the_same_bits() {
    let batch = picture(3, 9);
    let mut whole = Estimates::default();
    WelchFilter::default().transform(&batch, &mut whole).expect("nothing fails");
    assert!(whole.status().iter().all(|status| *status == Status::Ok));
    let [width, height] = SIZE;
    let halo = WelchFilter::default().requires().halo();
    let mut rows = 0..7;
    while !rows.is_empty() {
        let [above, below] = [rows.start.min(halo), (height - rows.end).min(halo)];
        let strip = strip(&batch, rows.start - above..rows.end + below, [above, below]);
        let mut part = Estimates::default();
        WelchFilter::default().apply(&strip, &mut part).expect("nothing fails");
        let pixels = (width * height) as usize;
        let range = (rows.start * width) as usize..(rows.end * width) as usize;
        let expected: Vec<f32> =
            (0..3).flat_map(|c| &whole.values()[c * pixels..][range.clone()]).copied().collect();
        assert!(part.values() == expected, "rows {rows:?}");
        rows = rows.end..height.min(rows.end + 11);
    }
}

/// Rows of a batch, some of them a halo.
pub(crate) fn strip(
    batch: &SequenceBatch,
    rows: std::ops::Range<u32>,
    halo: [u32; 2],
) -> SequenceBatch {
    let grid = batch.grid().expect("a picture");
    let cut = |lanes: &[f32]| -> Vec<f32> {
        let range = grid.width() * rows.start as usize..grid.width() * rows.end as usize;
        lanes.chunks_exact(grid.pixels()).flat_map(|plane| &plane[range.clone()]).copied().collect()
    };
    let n = *batch.sample_counts().last().expect("a term");
    let mut strip = SequenceBatch::from_last(&cut(batch.last()), n).expect("a batch");
    let part = Grid::new(SIZE[0], rows.len() as u32, grid.channels() as u32, rows.start);
    let part = part.and_then(|part| part.with_halo(halo[0], halo[1])).expect("a grid");
    strip.set_grid(part).expect("it fits");
    for side in Side::EVERY_OF_FOLDS {
        strip.set_side(side.clone(), cut(batch.side(side).expect("folds"))).expect("it fits");
    }
    strip
}

#[test]
fn pixels_that_are_not_finite_spoil_no_others() {
    let mut batch = picture(3, 11);
    let pixel = 12 * SIZE[0] as usize + 20;
    let mut fold = batch.side(&Side::Root(2)).expect("it is there").to_vec();
    fold[pixel] = f32::NAN;
    batch.set_side(Side::Root(2), fold).expect("it fits");
    let mut out = Estimates::default();
    WelchFilter::default().transform(&batch, &mut out).expect("nothing fails");
    let pixels = batch.grid().expect("a picture").pixels();
    for (lane, (value, status)) in out.values().iter().zip(out.status()).enumerate() {
        let expected = if lane % pixels == pixel { Status::NotFinite } else { Status::Ok };
        assert_eq!((value.is_finite(), *status), (true, expected), "lane {lane}");
    }
}

#[test]
fn an_infinite_mean_is_no_variance_of_its_neighbours() {
    let grid = Grid::new(5, 3, 1, 0).expect("a grid");
    let mut mean = [1.0; 15];
    mean[7] = f32::INFINITY;
    let planes = Planes::new(&grid, &Means { samples: 8.0, mean: &mean, root: &[1.0; 15] }, &[]);
    let mut out = [0.0; 15];
    WelchFilter::default().run(&planes, &mut out);
    assert!(out.iter().enumerate().all(|(i, value)| value.is_nan() == (i == 7)), "{out:?}");
}

/// Guides above 160 count as that here; squares of larger ones would drown distances.
#[test]
fn huge_guides_still_tell_pixels_apart() {
    let batch = picture(3, 5);
    let pixels = batch.grid().expect("a picture").pixels();
    let with = |value: f32| {
        let stripes: Vec<f32> = (0..pixels).map(|i| [0.0, value][i / 4 % 2]).collect();
        filtered(&batch, &vec![stripes; 3], Instructions::detect())
    };
    let [none, large, huge] = [0.0, 200.0, 1e30].map(with);
    assert_eq!(large, huge);
    assert_ne!(large, none);
    // An infinite one tells nothing.
    let infinite = with(f32::INFINITY);
    assert!((0..pixels).all(|i| infinite[i].is_nan() == (i / 4 % 2 == 1)));
}

#[test]
fn pictures_of_one_pixel_row_or_colour_stay() {
    for [width, height] in [[1, 1], [40, 1], [1, 40]] {
        let grid = Grid::new(width, height, 3, 0).expect("a grid");
        let samples = vec![0.7_f32; 8 * grid.lanes()];
        let mut batch = SequenceBatch::from_samples(grid.lanes(), &samples).expect("a batch");
        batch.set_grid(grid).expect("it fits");
        let mut out = Estimates::default();
        WelchFilter::default().transform(&batch, &mut out).expect("nothing fails");
        for value in out.values() {
            // Sums of equal numbers, over the sum of their weights.
            assert!((value / 0.7 - 1.0).abs() < 1e-5, "{value}");
        }
    }
}

#[test]
fn what_has_no_neighbours_stays() {
    let mut without_grid = SequenceBatch::from_samples(2, &[1.0, 3.0, 2.0, 3.0]).expect("a batch");
    let mut out = Estimates::default();
    WelchFilter::default().transform(&without_grid, &mut out).expect("nothing fails");
    let mut plain = Estimates::default();
    Identity.transform(&without_grid, &mut plain).expect("nothing fails");
    assert_eq!(out.values(), plain.values());
    assert_eq!(out.count(Status::NoFolds), 2);
    without_grid.set_grid(Grid::new(2, 1, 1, 0).expect("a grid")).expect("it fits");
    WelchFilter::default().transform(&without_grid, &mut out).expect("nothing fails");
    assert_eq!(out.count(Status::NoFolds), 2, "too few samples for folds");
}

#[test]
fn the_quantile_of_students_t() {
    // t with the probability .9975, by integration of the density.
    for (samples, t) in [(8.0, 4.0293), (24.0, 3.1040), (32.0, 3.0221)] {
        let approximate = f64::from(threshold(samples)).sqrt();
        // The expansion's next term at 7 degrees of freedom.
        assert!((approximate / t - 1.0).abs() < 6e-3, "{samples}: {approximate}");
    }
    assert!(threshold(3.0).is_finite() && threshold(1.0).is_finite());
}
