use super::*;
use crate::{
    filter::tests::{SIZE, filtered, guides, picture, planes_of, strip},
    gpu::{AdapterKind, LowerLimits, check::tests::adapter, kernel::tests::is_valid_shader},
};

const SOURCE: &str = include_str!("../filter.wgsl");

fn run(filter: &FilterGpu, planes: &Planes) -> Result<Vec<f32>, Error> {
    let mut out = vec![0.0; planes.grid.channels() * planes.grid.pixels()];
    filter.run(planes, &mut out).map(|()| out)
}

/// Needs no adapter.
#[test]
fn the_shader_is_valid() {
    assert!(is_valid_shader(SOURCE));
    // A store to the planes, which are read-only, must be noticed.
    assert!(!is_valid_shader(&SOURCE.replace("        means[(", "        planes[(")));
}

#[test]
fn results_are_the_cpus() {
    let Some(gpu) = adapter(|| Gpu::open(AdapterKind::Any)) else { return };
    let filter = FilterGpu::new(gpu).expect("it is right");
    for (channels, count) in [(1, 0), (3, 0), (2, 3), (3, 3), (1, 6), (3, 6)] {
        let batch = picture(channels, 5);
        let guides = guides(batch.grid().expect("a picture").pixels(), count);
        let on_cpu = filtered(&batch, &guides, crate::Instructions::detect());
        let on_gpu = run(&filter, &planes_of(&batch, &guides)).expect("it fits");
        // Sums of some 300 numbers in f32; no test is as close as that to its threshold.
        let near = |(gpu, cpu): (&f32, &f32)| (gpu / cpu - 1.0).abs() < 1e-4;
        assert!(on_gpu.iter().zip(&on_cpu).all(near), "{channels} channels, {count} guides");
        // The comparison sees a wrong result.
        let plain = batch.last().iter().zip(&on_cpu);
        assert!(plain.filter(|pair| !near(*pair)).count() > 100);
    }
}

/// However the rows are cut, by limits or as strips with a halo.
#[test]
fn limits_and_strips_change_no_bit() {
    let open = |limits: LowerLimits| {
        adapter(|| Gpu::open_with(AdapterKind::Any, &limits)).map(FilterGpu::new)
    };
    let Some(free) = open(LowerLimits::default()) else { return };
    let free = free.expect("it is right");
    let batch = picture(3, 9);
    let planes = planes_of(&batch, &guides(batch.grid().expect("a picture").pixels(), 6));
    let whole = run(&free, &planes).expect("it fits");
    let row = (planes.of_row() * size_of::<f32>()) as u64;
    for limits in [
        LowerLimits { invocations: Some(16), ..LowerLimits::default() },
        LowerLimits { workgroups: Some(5), ..LowerLimits::default() },
        // 24 rows: 4 at a time.
        LowerLimits { binding_bytes: Some(24 * row), ..LowerLimits::default() },
    ] {
        let filter = open(limits).expect("there is an adapter").expect("it is right");
        let part = filter.most_rows(&planes).expect("some");
        assert!(limits.binding_bytes.is_none() || part == 4, "{part} rows");
        assert!(run(&filter, &planes).expect("it fits") == whole, "{limits:?}");
    }
    let mut of_whole = Estimates::default();
    free.transform(&batch, &mut of_whole).expect("nothing fails");
    let [width, height] = SIZE;
    let pixels = (width * height) as usize;
    let halo = free.requires().halo();
    let inner = 14..20;
    let cut = strip(
        &batch,
        inner.start - halo..height.min(inner.end + halo),
        [halo, height.min(inner.end + halo) - inner.end],
    );
    let mut of_strip = Estimates::default();
    free.apply(&cut, &mut of_strip).expect("nothing fails");
    let range = (inner.start * width) as usize..(inner.end * width) as usize;
    let expected = (0..3).flat_map(|c| &of_whole.values()[c * pixels..][range.clone()]);
    assert!(of_strip.values().iter().eq(expected));
}

#[test]
fn limits_that_are_too_low_are_told() {
    let planes = |width| {
        let grid = Grid::new(width, 1, 1, 0).expect("a grid");
        let row = vec![1.0; width as usize];
        Planes::new(&grid, &Means { samples: 8.0, mean: &row, root: &row }, &[])
    };
    for limits in [
        // Enough for the picture that a filter is checked with, of 9 rows and those around.
        LowerLimits { binding_bytes: Some(1 << 17), ..LowerLimits::default() },
        LowerLimits { workgroups: Some(3), ..LowerLimits::default() },
    ] {
        let Some(gpu) = adapter(|| Gpu::open_with(AdapterKind::Any, &limits)) else { return };
        let filter = FilterGpu::new(gpu).expect("enough for a small picture");
        let error = run(&filter, &planes(4000)).expect_err("too low").to_string();
        assert!(error.contains("4000 pixels"), "{error}");
        assert_eq!(run(&filter, &planes(20)).expect("it works after").len(), 20);
    }
}

#[test]
fn pixels_that_do_not_count_are_no_numbers() {
    let Some(gpu) = adapter(|| Gpu::open(AdapterKind::Any)) else { return };
    let filter = FilterGpu::new(gpu).expect("it is right");
    let grid = Grid::new(5, 3, 1, 0).expect("a grid");
    let mut mean = [1.0; 15];
    mean[7] = f32::INFINITY;
    let planes = Planes::new(&grid, &Means { samples: 8.0, mean: &mean, root: &[1.0; 15] }, &[]);
    let out = run(&filter, &planes).expect("it fits");
    assert!(out.iter().enumerate().all(|(i, value)| value.is_nan() == (i == 7)), "{out:?}");
}

#[test]
fn wrong_shaders_are_refused() {
    let Some(gpu) = adapter(|| Gpu::open(AdapterKind::Any)) else { return };
    for (good, bad) in [
        ("RADIUS: i32 = 10", "RADIUS: i32 = 9"),
        ("noise <= 0.0", "noise >= 0.0"),
        ("id.y >= params.count", "id.y + 1u >= params.count"),
        ("differ += own_guides", "differ -= own_guides"),
        ("max(differ, 0.0)", "differ"),
        ("fn transform", "fn transfer"),
        ("params.stride", "params.strid"),
    ] {
        let wrong = SOURCE.replacen(good, bad, 1);
        assert_ne!(wrong, SOURCE, "{good}");
        assert!(FilterGpu::compile(gpu.clone(), &wrong).is_err(), "{bad}");
        // The same device goes on.
        FilterGpu::compile(gpu.clone(), SOURCE).expect("it is right");
    }
}
