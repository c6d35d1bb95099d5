//! The guard on pictures whose true values are known.

use std::{borrow::Cow, sync::Mutex, time::Duration};

use ndarray::Array2;

use super::{super::sample::GROUPS, *};
use crate::{
    Error, Estimates, FOLDS, Grid, GuardNetwork, LaneSums, Layer, Metadata, SequenceBatch, Side,
    Status, Strips, Support, Transform, WelchFilter, Whole, guard::Guard, random::SplitMix64,
};

const WIDTH: usize = 52;
const HEIGHT: usize = 44;

/// The true value of a lane: two areas, a gradient, and a line of bright pixels.
fn truth(grid: &Grid, lane: usize) -> f64 {
    let (x, y) = (lane % grid.width(), lane % grid.pixels() / grid.width());
    let channel = (1 + lane / grid.pixels()) as f64;
    let area = if x > 2 * y { 0.2 } else { 1.0 };
    let line = if x == 20 { 8.0 } else { 0.0 };
    channel * (area + 0.01 * y as f64 + line)
}

/// A picture of this many samples per pixel, which are 0 or up to four times the true value.
fn picture(grid: Grid, samples: usize, seed: u64) -> SequenceBatch {
    let mut random = SplitMix64(seed);
    let lanes = grid.lanes();
    let (mut sums, mut values) = (vec![LaneSums::default(); lanes], vec![0.0; samples]);
    let mut last = vec![0.0; lanes];
    for (lane, sums) in sums.iter_mut().enumerate() {
        let mean = truth(&grid, lane);
        for (i, value) in values.iter_mut().enumerate() {
            *value = if random.uniform() < 0.5 { 0.0 } else { 4.0 * mean * random.uniform() };
            sums.add(i as u32, *value);
        }
        last[lane] = (values.iter().sum::<f64>() / samples as f64) as f32;
    }
    let mut batch = SequenceBatch::from_last(&last, samples as u32).expect("lanes");
    batch.set_grid(grid).expect("as many lanes");
    for side in Side::of_sums(samples as u32) {
        let mut values = vec![0.0; lanes];
        LaneSums::write_side(&sums, side, samples as u32, &mut values);
        batch.set_side(side.clone(), values).expect("one value per lane");
    }
    batch
}

fn grid(channels: u32) -> Grid {
    Grid::new(WIDTH as u32, HEIGHT as u32, channels, 0).expect("a grid")
}

/// An expert that a test describes: what it says of a lane whose plain estimate it knows.
struct Says<F>(F);

impl<F: Fn(&Grid, usize, f32) -> f32 + Send + Sync> PictureExpert for Says<F> {
    fn name(&self) -> &str {
        "told"
    }

    fn support(&self) -> Support {
        Support::Pixel
    }

    fn estimate(&self, seen: &SeenPicture<'_>, out: &mut [f32]) -> Result<(), Error> {
        let grid = *seen.grid;
        let inner = grid.inner(seen.mean);
        for (lane, (out, &mean)) in out.iter_mut().zip(&*inner).enumerate() {
            *out = (self.0)(&grid, lane, mean);
        }
        Ok(())
    }
}

fn guard(experts: Vec<Box<dyn PictureExpert>>) -> PictureGuard {
    PictureGuard::new(Guard::default(), experts).expect("few experts")
}

/// The squared errors of T and of S, summed, and the estimates.
fn errors(guard: &PictureGuard, batch: &SequenceBatch) -> ([f64; 2], Estimates) {
    let mut out = Estimates::default();
    guard.transform(batch, &mut out).expect("nothing fails");
    let grid = batch.grid().expect("a picture");
    let error = |values: &[f32]| -> f64 {
        let lanes = values.iter().enumerate();
        lanes.map(|(lane, x)| (f64::from(*x) - truth(grid, lane)).powi(2)).sum()
    };
    ([error(out.values()), error(batch.last())], out)
}

/// MSE_T/MSE_S over some runs.
fn ratio(guard: &PictureGuard, samples: usize, runs: u64) -> f64 {
    let sums = (0..runs).map(|seed| errors(guard, &picture(grid(3), samples, seed)).0);
    let sums = sums.fold([0.0; 2], |sum, it| [sum[0] + it[0], sum[1] + it[1]]);
    sums[0] / sums[1]
}

#[test]
fn garbage_is_not_trusted() {
    let noise = |lane: usize, x: f32| ((lane * 7919) as f32 * x).sin() * 3.0;
    let experts: [(&str, Box<dyn PictureExpert>); 5] = [
        ("a constant", Box::new(Says(|_: &Grid, _, _| 7.0))),
        ("noise", Box::new(Says(move |_: &Grid, lane, mean| mean + noise(lane, mean)))),
        ("another picture", Box::new(Says(|grid: &Grid, lane, _| truth(grid, lane / 2) as f32))),
        ("NaN", Box::new(Says(|_: &Grid, _, _| f32::NAN))),
        ("infinity", Box::new(Says(|_: &Grid, _, _| f32::INFINITY))),
    ];
    for (name, expert) in experts {
        let ratio = ratio(&guard(vec![expert]).without_lane(), 16, 6);
        assert!(ratio < 1.01, "{name}: {ratio}");
    }
}

#[test]
fn good_estimates_are_trusted_and_the_gain_is_predicted() {
    // It errs by a quarter, β² = .0625 I², and V = .104 I²: at best, β²/(V + β²) = .375 is left.
    let errs = |lane: usize| if lane.is_multiple_of(3) { 0.75 } else { 1.25 };
    let expert = move |grid: &Grid, lane: usize, _| (errs(lane) * truth(grid, lane)) as f32;
    let guard = guard(vec![Box::new(Says(expert))]).without_lane();
    let [mut sums, mut told, mut inside] = [[0.0; 2], [0.0; 2], [0.0; 2]];
    for seed in 20..28 {
        let batch = picture(grid(3), 16, seed);
        let fitted = guard.fit(&mut Whole::new(&batch)).expect("nothing fails");
        let judgement = fitted.judgement().expect("it has judged");
        let ([of_t, of_s], out) = errors(&guard, &batch);
        let [low, high] = judgement.interval;
        inside[usize::from(low < of_t / of_s && of_t / of_s < high)] += 1.0;
        sums = [sums[0] + of_t, sums[1] + of_s];
        let squares: f64 = out.errors().iter().map(|e| f64::from(*e).powi(2)).sum();
        told = [told[0] + judgement.ratio, told[1] + squares];
    }
    let ratio = sums[0] / sums[1];
    assert!(ratio < 0.5, "{ratio}");
    // Eight intervals of 95 % contain all, or all but one.
    assert!(inside[1] >= 7.0, "{inside:?}");
    // Their means have less noise than a tenth.
    assert!((told[0] / 8.0 / ratio - 1.0).abs() < 0.15, "{told:?} {ratio}");
    assert!((told[1] / sums[0] - 1.0).abs() < 0.25, "{told:?} {sums:?}");
}

#[test]
fn the_weights_of_pixels_are_those_of_the_estimates() {
    let bias = |lane: usize| if lane % WIDTH < WIDTH / 2 { 1.0 } else { 2.0 };
    let expert = move |grid: &Grid, lane: usize, _| (bias(lane) * truth(grid, lane)) as f32;
    let guard = guard(vec![Box::new(Says(expert))]).without_lane();
    let batch = picture(grid(3), 16, 3);
    let fitted = guard.fit(&mut Whole::new(&batch)).expect("nothing fails");
    assert!(fitted.has_weights());
    let mut out = Estimates::default();
    fitted.apply(&batch, &mut out).expect("nothing fails");
    let (grid, weights) = (batch.grid().expect("a picture"), out.weights());
    assert_eq!(weights.len(), grid.pixels());
    for (lane, (t, s)) in out.values().iter().zip(batch.last()).enumerate() {
        let w = weights[lane % grid.pixels()];
        let blend = s + w * (expert(grid, lane, 0.0) - s);
        assert!((0.0..=1.0).contains(&w) && (t - blend).abs() <= 1e-4 * t.abs(), "{lane}: {w}");
    }
    // Who is right on the left is trusted there, and not on the right.
    let mean = |of: fn(usize) -> bool| {
        let columns = weights.iter().enumerate().filter(|(pixel, _)| of(pixel % WIDTH));
        2.0 * columns.map(|(_, w)| w).sum::<f32>() / weights.len() as f32
    };
    let [left, right] = [mean(|x| x < WIDTH / 2), mean(|x| x >= WIDTH / 2)];
    assert!(left > 0.6 && right < 0.4, "{left} {right}");
}

#[test]
fn with_many_samples_a_biased_expert_is_left() {
    let guard = guard(vec![Box::new(Says(|grid: &Grid, lane, _| 1.3 * truth(grid, lane) as f32))]);
    let guard = guard.without_lane();
    let batch = picture(grid(3), 4096, 0);
    let (_, out) = errors(&guard, &batch);
    let sum = |values: &[f32]| values.iter().map(|x| f64::from(x.abs())).sum::<f64>();
    let changes = out.values().iter().zip(batch.last()).map(|(t, s)| t - s);
    let change = sum(&changes.collect::<Vec<_>>()) / sum(batch.last());
    assert!(change < 0.01, "{change}");
    // With V = .0004 I² and β² = .09 I², half a percent is gained; as much again is noise.
    let ratio = ratio(&guard, 4096, 2);
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
}

/// On a large picture, the guard of lanes goes on alone where others would take too long, and says so.
#[test]
fn experts_keep_within_their_time() {
    let guard = |limit: Option<f64>| {
        let of_time = TimeLimit::default();
        let guard = guard(vec![Box::new(Vertical)]).within(of_time.clone());
        limit.into_iter().for_each(|seconds| of_time.set(Duration::from_secs_f64(seconds)));
        guard
    };
    let even = |grid: Grid| {
        let lanes: Vec<f32> = (0..grid.lanes()).map(|lane| truth(&grid, lane) as f32).collect();
        let mut batch = SequenceBatch::from_last(&lanes, 4).expect("lanes");
        batch.set_grid(grid).expect("as many lanes");
        for side in Side::of_sums(4) {
            batch.set_side(side.clone(), lanes.clone()).expect("one value per lane");
        }
        batch
    };
    let judged = |limit, grid: Grid| {
        let (batch, guard) = (even(grid), guard(limit));
        let fitted = guard.fit(&mut Whole::new(&batch)).expect("nothing fails");
        (fitted.has_weights(), fitted.judgement().expect("it has judged").notes.join("; "))
    };
    let large = Grid::new(1024, 640, 1, 0).expect("a grid");
    for limit in [None, Some(1e6)] {
        assert_eq!(judged(limit, large), (true, String::new()));
    }
    let (has_weights, notes) = judged(Some(1e-6), large);
    assert!(!has_weights && notes.contains("left out: vertical, which would take"), "{notes}");
    assert_eq!(judged(Some(1e-6), grid(1)), (true, String::new()), "a small one takes no time");
    // Of strips with a halo, it estimates the same rows as the experts would have.
    let (batch, guard) = (even(large), guard(Some(1e-6)));
    let [values, in_strips] = [640, 100].map(|step| in_strips(&guard, &batch, step).0);
    assert!(values == in_strips && values.len() == 2 * large.lanes());
}

/// An expert that looks around: the mean of the pixels one row above and below.
struct Vertical;

impl PictureExpert for Vertical {
    fn name(&self) -> &str {
        "vertical"
    }

    fn support(&self) -> Support {
        Support::Radius(1)
    }

    fn estimates_emission(&self) -> bool {
        true
    }

    fn estimate(&self, seen: &SeenPicture<'_>, out: &mut [f32]) -> Result<(), Error> {
        let (grid, inner) = (seen.grid, seen.grid.inner_rows());
        let at = |c: usize, y: usize, x: usize| seen.mean[grid.lanes_of(c, y..y + 1).start + x];
        let mut next = out.iter_mut();
        for c in 0..grid.channels() {
            for y in inner.clone() {
                for x in 0..grid.width() {
                    let (up, down) = (y.saturating_sub(1), (y + 1).min(grid.rows() - 1));
                    let sum = at(c, up, x) + at(c, y, x) + at(c, down, x);
                    *next.next().expect("one for each lane") = sum / 3.0;
                }
            }
        }
        Ok(())
    }
}

/// A picture cut into strips of some rows, with a halo.
struct Cut<'a> {
    batch: &'a SequenceBatch,
    step: usize,
    next: usize,
    halo: usize,
}

impl Strips for Cut<'_> {
    fn rewind(&mut self, halo: u32) -> Result<(), Error> {
        (self.next, self.halo) = (0, halo as usize);
        Ok(())
    }

    fn next_strip(&mut self) -> Result<Option<Cow<'_, SequenceBatch>>, Error> {
        let grid = *self.batch.grid().expect("a picture");
        let (first, end) = (self.next, grid.rows().min(self.next + self.step));
        self.next = end;
        if first == end {
            return Ok(None);
        }
        let (top, bottom) = (first.saturating_sub(self.halo), grid.rows().min(end + self.halo));
        let planes = |values: &[f32]| -> Vec<f32> {
            let planes = (0..values.len() / grid.pixels()).map(|c| grid.lanes_of(c, top..bottom));
            planes.flat_map(|lanes| values[lanes].to_vec()).collect()
        };
        let last = planes(self.batch.last());
        let terms = Array2::from_shape_vec((1, last.len()), last).expect("its shape");
        let mut strip = SequenceBatch::new(terms, self.batch.sample_counts().to_vec())?;
        let [width, rows, channels] =
            [grid.width(), bottom - top, grid.channels()].map(|x| x as u32);
        let part = Grid::new(width, rows, channels, top as u32)?;
        strip.set_grid(part.with_halo((first - top) as u32, (bottom - end) as u32)?)?;
        for (side, values) in self.batch.sides() {
            strip.set_side(side.clone(), planes(values))?;
        }
        Ok(Some(Cow::Owned(strip)))
    }
}

/// A picture with emission on some pixels and features, whose folds differ.
fn with_features(mut batch: SequenceBatch) -> SequenceBatch {
    let grid = *batch.grid().expect("a picture");
    for fold in 0..FOLDS as u8 {
        let emission = |lane: usize| {
            let bright = (lane % grid.pixels()).is_multiple_of(37);
            let mean = batch.side(&Side::Fold(fold)).map_or(0.0, |means| means[lane]);
            if bright { 0.5 * mean } else { 0.0 }
        };
        let emission = (0..grid.lanes()).map(emission).collect();
        let albedo = (0..grid.lanes()).map(|lane| (lane % 5 + usize::from(fold)) as f32 / 9.0);
        let (albedo, normal) = (albedo.collect(), vec![f32::from(fold); 3 * grid.pixels()]);
        batch.set_side(Side::EmissionFold(fold), emission).expect("its lanes");
        batch.set_side(Side::AlbedoFold(fold), albedo).expect("its lanes");
        batch.set_side(Side::NormalFold(fold), normal).expect("its pixels");
    }
    batch
}

/// What is estimated of a picture that comes in strips of this many rows.
fn in_strips(guard: &PictureGuard, batch: &SequenceBatch, step: usize) -> (Vec<u32>, String) {
    let grid = *batch.grid().expect("a picture");
    let mut strips = Cut { batch, step, next: 0, halo: 0 };
    let fitted = guard.fit(&mut strips).expect("nothing fails");
    strips.rewind(guard.requires().halo()).expect("it can");
    let mut rows: Vec<Vec<u32>> = vec![Vec::new(); grid.channels()];
    let mut out = Estimates::default();
    while let Some(strip) = strips.next_strip().expect("nothing fails") {
        fitted.apply(&strip, &mut out).expect("nothing fails");
        let bits = |values: &[f32]| values.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let pixels = out.values().len() / grid.channels();
        let planes = out.values().chunks_exact(pixels).zip(out.errors().chunks_exact(pixels));
        for (rows, (values, errors)) in rows.iter_mut().zip(planes) {
            for (values, errors) in values.chunks(grid.width()).zip(errors.chunks(grid.width())) {
                rows.extend(bits(values));
                rows.extend(bits(errors));
            }
        }
    }
    (rows.concat(), format!("{:?}", fitted.judgement()))
}

#[test]
fn strips_and_threads_make_no_difference() {
    let batch = with_features(picture(grid(3), 8, 3));
    let closed = || guard(vec![Box::new(WelchFilter::default()), Box::new(Vertical)]);
    let learned = || closed().without_lane().learned(network("filter", 1.0));
    for (guard, is_learned) in [(closed(), false), (learned(), true)] {
        let whole = in_strips(&guard, &batch, HEIGHT);
        assert!(whole.1.contains(&format!("learned: {is_learned}")), "{}", whole.1);
        for step in [1, 7, 16] {
            assert!(in_strips(&guard, &batch, step) == whole, "{step}");
        }
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
        assert!(alone.install(|| in_strips(&guard, &batch, HEIGHT)) == whole);
        // Another picture has other bits.
        assert!(in_strips(&guard, &with_features(picture(grid(3), 8, 4)), HEIGHT) != whole);
    }
}

/// A network for experts of this name and `vertical`, with any weights, which adds `more` to the
/// output of the first.
fn network(name: &str, more: f32) -> GuardMlp {
    let mut random = SplitMix64(11);
    let mut layer = |outputs: usize, inputs: usize| Layer {
        weight: Array2::from_shape_fn((outputs, inputs), |_| random.uniform() as f32 - 0.5),
        bias: vec![0.0; outputs].into(),
    };
    let mut layers = vec![layer(8, INPUTS), layer(2, 8)];
    layers[1].bias[0] = more;
    let metadata = Metadata {
        window: INPUTS,
        negative_slope: 0.01,
        trained_on: Vec::new(),
        samples: (8, 64),
        sampler: None,
        loss: String::new(),
        epochs: 0,
        seed: 0,
        config: String::new(),
    };
    let experts = vec![name.to_owned(), "vertical".to_owned()];
    let network = GuardNetwork::new(layers, metadata, experts, 0.02).expect("it fits");
    GuardMlp::new(network)
}

/// An expert that is right but for a tenth.
fn nearly() -> Box<dyn PictureExpert> {
    Box::new(Says(|grid: &Grid, lane, _| 1.1 * truth(grid, lane) as f32))
}

/// What a guard of these experts and a network says of a picture, and the errors of T and S.
fn learned(
    experts: Vec<Box<dyn PictureExpert>>,
    network: GuardMlp,
    samples: usize,
) -> (bool, String, [f64; 2]) {
    let guard = guard(experts).without_lane().learned(network);
    let batch = picture(grid(3), samples, 8);
    let fitted = guard.fit(&mut Whole::new(&batch)).expect("nothing fails");
    let judgement = fitted.judgement().expect("it has judged");
    (judgement.learned, judgement.notes.join("; "), errors(&guard, &batch).0)
}

#[test]
fn a_network_corrects_weights_where_that_is_no_loss() {
    let experts = || -> Vec<Box<dyn PictureExpert>> { vec![nearly(), Box::new(Vertical)] };
    let closed = errors(&guard(experts()).without_lane(), &picture(grid(3), 16, 8)).0;
    // One that is for the expert which is right, and one that is for the other.
    let (used, notes, good) = learned(experts(), network("told", 5.0), 16);
    assert!(used && notes.is_empty() && good != closed, "{notes}");
    assert!(good[0] < closed[0] * 1.02 && closed[0] < 0.5 * closed[1], "{good:?} {closed:?}");
    let (used, notes, bad) = learned(experts(), network("told", -9.0), 16);
    assert!(!used && bad == closed, "{notes}");
    assert_eq!(
        notes,
        "left out: the network that weighs experts: samples that were held out say \
                       that it loses here"
    );
}

#[test]
fn a_network_knows_its_experts_and_its_samples() {
    let (used, notes, _) = learned(vec![nearly()], network("filter", 0.0), 16);
    assert!(!used && notes.contains("that weighs experts: it does not know 'told'"), "{notes}");
    for (samples, known) in [(7, false), (8, true), (64, true), (65, false)] {
        let (used, notes, _) = learned(vec![nearly()], network("told", 0.0), samples);
        let said = notes.contains("that weighs experts: it knows 8 to 64 samples per pixel");
        assert_eq!((used, said), (known, !known), "{samples}: {notes}");
    }
}

/// The same picture in another unit, which is a power of 4, so that nothing is rounded.
fn in_unit(unit: f32, batch: &SequenceBatch) -> SequenceBatch {
    let scaled = |values: &[f32], by: f32| values.iter().map(|x| by * x).collect::<Vec<_>>();
    let mut other = SequenceBatch::from_last(&scaled(batch.last(), unit), 16).expect("lanes");
    other.set_grid(*batch.grid().expect("a picture")).expect("as many lanes");
    for (side, values) in batch.sides() {
        let by = match side {
            Side::Fold(_) => unit,
            Side::Root(_) => unit.sqrt(),
            _ => unit * unit,
        };
        other.set_side(side.clone(), scaled(values, by)).expect("its lanes");
    }
    other
}

#[test]
fn a_learned_guard_has_the_unit_of_its_samples() {
    let guard = || {
        let guard = guard(vec![Box::new(Vertical)]).without_lane();
        guard.learned(network("told", 0.0))
    };
    let batch = picture(grid(3), 16, 9);
    let values = errors(&guard(), &batch).1;
    for unit in [4.0_f32.powi(-20), 4.0_f32.powi(20)] {
        let scaled = errors(&guard(), &in_unit(unit, &batch)).1;
        let expected: Vec<f32> = values.values().iter().map(|x| unit * x).collect();
        assert_eq!(scaled.values(), expected, "{unit}");
    }
    assert!(values.values() != batch.last());
}

#[test]
fn a_training_table_says_what_the_guard_does() {
    let batch = with_features(picture(grid(3), 16, 4));
    let guard = guard(vec![Box::new(Vertical)]).without_lane();
    let table = guard.training_table(&batch).expect("nothing fails");
    let (_, out) = errors(&guard, &batch);
    assert_eq!(
        (&table.experts[..], table.cell, table.samples),
        (&["vertical".to_owned()][..], 8, 16)
    );
    let (mut worst, mut largest) = (0.0_f32, 0.0_f32);
    for (i, t) in out.values().iter().enumerate() {
        let (c, y, x) = (i / (WIDTH * HEIGHT), i / WIDTH % HEIGHT, i % WIDTH);
        let change = table.changes[[0, c, y, x]];
        let w = out.weights()[y * WIDTH + x];
        worst = worst.max((table.rest[[c, y, x]] + w * change - t).abs());
        largest = largest.max(change.abs());
        assert!((0.0..19.0).contains(&table.places[[y, x]]));
    }
    assert!(worst < 1e-5 && largest > 0.1, "{worst} {largest}");
    // Where a pixel is, the network reads something, and the halves say different things.
    let (row, column, knot) = (2, 3, table.places[[20, 28]] as usize);
    let of_cell = |half: usize| table.closed[[row, column, knot, half, 0]];
    assert!((0.0..=1.0).contains(&of_cell(0)) && of_cell(0) != of_cell(1));
    assert!((0..INPUTS).any(|i| table.inputs[[row, column, knot, 0, i]] != 0.0));
    let lanes = SequenceBatch::from_last(batch.last(), 16).expect("lanes");
    assert!(guard.training_table(&lanes).is_err());
}

/// What an expert has seen: how many samples, and the first mean, root, albedo and normal.
type Seen = [f32; 5];

/// An expert that estimates emission, too, as a test says.
struct Watched<F>(F);

impl<F: Fn(&SeenPicture<'_>, &mut [f32]) + Send + Sync> PictureExpert for Watched<F> {
    fn name(&self) -> &str {
        "watched"
    }

    fn support(&self) -> Support {
        Support::Picture
    }

    fn estimates_emission(&self) -> bool {
        true
    }

    fn estimate(&self, seen: &SeenPicture<'_>, out: &mut [f32]) -> Result<(), Error> {
        (self.0)(seen, out);
        Ok(())
    }
}

/// A panel of one expert.
fn panel_of<'a>(batch: &SequenceBatch, expert: &'a dyn PictureExpert) -> panel::Panel<'a> {
    let (lane, experts) = (guard_of_lanes(batch), vec![expert]);
    panel::Panel { lane, blends_lane: false, experts, counts: [2.0; FOLDS], unit: 1.0 }
}

#[test]
fn nothing_that_is_held_out_is_seen() {
    // Pixel 0 emits.
    let batch = with_features(picture(grid(3), 8, 5));
    let seen: Mutex<Vec<Seen>> = Mutex::default();
    let expert = Watched(|it: &SeenPicture<'_>, out: &mut [f32]| {
        let of = |feature: Option<SeenFeature<'_>>| feature.map_or(f32::NAN, |it| it.mean[0]);
        let [mean, root, albedo, normal] = [it.mean[0], it.root[0], of(it.albedo), of(it.normal)];
        seen.lock().expect("no panic").push([it.samples as f32, mean, root, albedo, normal]);
        out.fill(mean * mean);
    });
    let panel = panel_of(&batch, &expert);
    let strip = layers::Strip::new(&batch).expect("it has folds");
    let fold = |side: fn(u8) -> Side, fold: u8| batch.side(&side(fold)).expect("a fold")[0];
    for group in 0..FOLDS as u8 {
        seen.lock().expect("no panic").clear();
        let Ok(held) = panel.look(&strip, group.into()) else { panic!("nothing fails") };
        let mean = |side: fn(u8) -> Side| {
            let others = (0..FOLDS as u8).filter(|it| *it != group).map(|it| fold(side, it));
            others.sum::<f32>() / 3.0
        };
        let seen = seen.lock().expect("no panic");
        let [reflected, emitted, light] = seen[..] else { panic!("two layers, and both") };
        let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
        assert!(seen.iter().all(|it| it[0] == 6.0));
        assert!(near(light[1], mean(Side::Fold)), "{group}");
        assert!(near(emitted[1], mean(Side::EmissionFold)), "{group}");
        assert!(near(reflected[1], mean(Side::Fold) - mean(Side::EmissionFold)), "{group}");
        // Its roots are not known where a pixel emits.
        assert!(seen.iter().all(|it| it[2].is_nan()));
        assert!(near(reflected[3], mean(Side::AlbedoFold)), "{group}");
        assert!(near(reflected[4], mean(Side::NormalFold)), "{group}");
        // Of emission it says its square; then, by how much the square of all light is more than
        // that of what is reflected.
        let emission = emitted[1];
        let squares = [emission * emission, light[1] * light[1] - reflected[1] * reflected[1]];
        let changes = [0, 1].map(|way: usize| held[layers::EMITTED].changes[way][0]);
        for (change, square) in changes.into_iter().zip(squares) {
            assert!((change - (square - emission)).abs() < 1e-5, "{group} {changes:?} {squares:?}");
        }
        assert!((changes[1] - changes[0]).abs() > 1e-3, "{changes:?}");
    }
}

#[test]
fn emission_is_asked_for_where_there_is_any() {
    // One pixel of 37 emits, and a row has fewer.
    let batch = with_features(picture(Grid::new(16, 24, 3, 0).expect("a grid"), 8, 5));
    let asked = Mutex::new(Vec::new());
    let expert = Watched(|seen: &SeenPicture<'_>, _: &mut [f32]| {
        asked.lock().expect("no panic").push(seen.asked.to_vec());
    });
    let panel = panel_of(&batch, &expert);
    // Rows 5 to 14, with a halo.
    let mut strips = Cut { batch: &batch, step: 10, next: 5, halo: 2 };
    let strip = strips.next_strip().expect("nothing fails").expect("a strip");
    let strip = layers::Strip::new(&strip).expect("it has folds");
    assert!(panel.look(&strip, GROUPS).is_ok());
    let emits = |row: usize| (16 * row..16 * (row + 1)).any(|pixel| pixel % 37 == 0);
    let emitting: Vec<bool> = (5..15).map(emits).collect();
    assert!(emitting.contains(&true) && emitting.contains(&false));
    assert_eq!(*asked.lock().expect("no panic"), [vec![true; 10], emitting.clone(), emitting]);
}

#[test]
fn too_many_experts_are_refused() {
    let vertical = |_| Box::new(Vertical) as Box<dyn PictureExpert>;
    let of = |experts: Vec<_>| PictureGuard::new(Guard::default(), experts).map(|_| ());
    let said = |experts| of(experts).expect_err("too many").to_string();
    assert!(of(vec![vertical(0)]).is_ok() && of((0..3).map(|_| nearly()).collect()).is_ok());
    assert!(said((0..4).map(|_| nearly()).collect()).contains("4 experts that look at neighbours"));
    assert!(said((0..2).map(vertical).collect()).contains("2 experts that estimate emission"));
}

/// What the guard of lanes makes of a picture.
fn guard_of_lanes(batch: &SequenceBatch) -> crate::guard::FittedGuard<'static> {
    static GUARD: std::sync::LazyLock<Guard> = std::sync::LazyLock::new(Guard::default);
    GUARD.measure(&mut Whole::new(batch)).expect("nothing fails")
}

struct Fails;

impl PictureExpert for Fails {
    fn name(&self) -> &str {
        "lost"
    }

    fn support(&self) -> Support {
        Support::Pixel
    }

    fn estimate(&self, _: &SeenPicture<'_>, _: &mut [f32]) -> Result<(), Error> {
        Err(Error::Batch("it has no library".into()))
    }
}

#[test]
fn an_expert_that_fails_is_left_out() {
    let batch = picture(grid(3), 8, 6);
    let with = guard(vec![Box::new(Fails), Box::new(Vertical)]);
    let without = guard(vec![Box::new(Vertical)]);
    let (a, b) = (errors(&with, &batch).1, errors(&without, &batch).1);
    assert!(a == b);
    let fitted = with.fit(&mut Whole::new(&batch)).expect("nothing else fails");
    let judgement = fitted.judgement().expect("it has judged");
    assert_eq!(judgement.notes, ["'lost' is left out: it has no library"]);
    assert_eq!(judgement.experts.len(), 2);
}

#[test]
fn there_may_be_no_picture_or_little_of_it() {
    let guard = guard(vec![Box::new(WelchFilter::default()), Box::new(Vertical)]);
    for (width, height, channels) in [(1, 1, 3), (1, 1, 1), (9, 1, 3), (1, 9, 2), (3, 3, 10)] {
        let grid = Grid::new(width, height, channels, 0).expect("a grid");
        let batch = picture(grid, 8, 1);
        let (_, out) = errors(&guard, &batch);
        let finite = out.values().iter().all(|value| value.is_finite());
        assert!(finite && out.values().len() == batch.lanes(), "{width} {height} {channels}");
    }
    // Fewer samples than folds, and no grid: as the guard of lanes.
    let few = picture(grid(3), 3, 1);
    let mut out = Estimates::default();
    guard.transform(&few, &mut out).expect("nothing fails");
    assert_eq!((out.values(), out.count(Status::NoFolds)), (few.last(), few.lanes()));
    let lanes: Vec<f32> = (0..8 * 500).map(|i| (i * 7919 % 41) as f32).collect();
    let batch = SequenceBatch::from_samples(500, &lanes).expect("lanes");
    let mut of_lanes = Estimates::default();
    guard.transform(&batch, &mut out).expect("nothing fails");
    Guard::default().transform(&batch, &mut of_lanes).expect("nothing fails");
    assert!(out == of_lanes);
}

/// What emission a lane is said to have, by what it has in a fold.
type Lie = fn(usize, u8, f32) -> f32;

#[test]
fn emission_that_is_no_part_of_the_radiance_does_no_harm() {
    let lies: [(&str, Lie); 7] = [
        ("the truth", |_, _, e| e),
        ("ten times as much", |_, _, e| 10.0 * e),
        ("below 0", |lane, _, e| if lane.is_multiple_of(5) { e - 3.0 } else { e }),
        ("where there is none", |lane, _, e| if lane.is_multiple_of(5) { e + 30.0 } else { e }),
        ("in one fold", |_, fold, e| if fold == 2 { e + 100.0 } else { e }),
        ("no number", |_, _, _| f32::NAN),
        ("infinite", |_, _, _| f32::INFINITY),
    ];
    let guard = guard(vec![Box::new(Vertical)]);
    let of_runs = |lie: Lie| {
        let mut sums = [0.0; 2];
        for seed in 0..4 {
            let mut batch = with_features(picture(grid(3), 16, seed));
            for fold in 0..FOLDS as u8 {
                let emission = batch.side(&Side::EmissionFold(fold)).expect("a fold").iter();
                let said = emission.enumerate().map(|(lane, e)| lie(lane, fold, *e)).collect();
                batch.set_side(Side::EmissionFold(fold), said).expect("its lanes");
            }
            let fitted = guard.fit(&mut Whole::new(&batch)).expect("nothing fails");
            let notes = fitted.judgement().expect("it has judged").notes.join("; ");
            let says = notes.contains("pixels, emission is no part of the radiance");
            let is_true = lie(5, 2, 1.0) == 1.0 && lie(6, 2, 1.0) == 1.0;
            assert_eq!(says, !is_true, "{notes}");
            let of = errors(&guard, &batch).0;
            sums = [sums[0] + of[0], sums[1] + of[1]];
        }
        sums[0] / sums[1]
    };
    // With the truth it is .3. Lies that are believed have up to 1.
    for (name, lie) in lies {
        let ratio = of_runs(lie);
        assert!(ratio < 0.6, "{name}: {ratio}");
    }
}

#[test]
fn what_is_not_finite_stays_where_it_is() {
    let mut batch = with_features(picture(grid(3), 8, 2));
    let lane = 30 * WIDTH + 30;
    let mut means = batch.side(&Side::Fold(1)).expect("a fold").to_vec();
    means[lane] = f32::NAN;
    batch.set_side(Side::Fold(1), means).expect("its lanes");
    let mut normals = batch.side(&Side::NormalFold(2)).expect("a fold").to_vec();
    normals[7] = f32::INFINITY;
    batch.set_side(Side::NormalFold(2), normals).expect("its pixels");
    // Of the same pixel, which counts once; and of another one.
    let mut albedo = batch.side(&Side::AlbedoFold(1)).expect("a fold").to_vec();
    (albedo[7 + WIDTH * HEIGHT], albedo[9]) = (f32::NAN, f32::NAN);
    batch.set_side(Side::AlbedoFold(1), albedo).expect("its lanes");
    let guard = guard(vec![Box::new(WelchFilter::default()), Box::new(Vertical)]);
    let fitted = guard.fit(&mut Whole::new(&batch)).expect("nothing fails");
    let notes = &fitted.judgement().expect("it has judged").notes;
    let said = ["in 2 of 2288 pixels, albedo or normals are not finite, and tell nothing there"];
    assert_eq!(notes[..], said);
    let (_, out) = errors(&guard, &batch);
    assert!(out.values().iter().all(|value| value.is_finite()));
    // What is not finite changes weights a little; in most lanes by less than noise of S, .1 to .3.
    let far = errors(&guard, &with_features(picture(grid(3), 8, 2))).1;
    let same =
        out.values().iter().zip(far.values()).filter(|(a, b)| (*a - *b).abs() < 0.05).count();
    assert!(same > batch.lanes() * 95 / 100, "{same}");
}
