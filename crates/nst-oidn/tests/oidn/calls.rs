//! What is called when all goes well.

use std::thread;

use nst_oidn::{DeviceKind, Image, Tiling};

use crate::fake::Fake;

/// A picture of 3 × 2 pixels: each value is different.
pub(crate) fn layer(begin: f32) -> Vec<f32> {
    (0..18u8).map(|i| begin + f32::from(i)).collect()
}

/// 2 color + albedo + 10 normal, which the fake computes; without rounding, as all are whole.
fn expected(image: &Image<'_>) -> Vec<f32> {
    let value = |layer: Option<&[f32]>, i: usize| layer.map_or(0.0, |layer| layer[i]);
    let sum = |i| 2.0 * image.color[i] + value(image.albedo, i) + 10.0 * value(image.normal, i);
    (0..image.color.len()).map(sum).collect()
}

#[test]
fn every_call_has_its_arguments() {
    let fake = Fake::new(&[]);
    let (color, albedo, normal) = (layer(1.0), layer(100.0), layer(1000.0));
    let image = Image {
        albedo: Some(&albedo),
        normal: Some(&normal),
        hdr: true,
        input_scale: Some(0.25),
        ..Image::new(3, 2, &color)
    };
    let mut out = vec![f32::NAN; 18];
    {
        let device = fake.device().expect("a device").with_max_memory(300);
        assert_eq!(device.version().to_string(), "2.5.1");
        assert_eq!((device.kind(), device.path()), (DeviceKind::Cpu, fake.path()));
        device.denoise(&image, &mut out).expect("a denoised picture");
    }
    assert_eq!(out, expected(&image));
    let log = [
        "oidnNewDevice 0 = 1",
        "oidnCommitDevice 1",
        "oidnGetDeviceInt 1 version",
        "oidnGetDeviceInt 1 type",
        "oidnNewFilter 1 RT = 2",
        "oidnNewBuffer 1 72 = 3",
        "oidnSetFilterImage 2 color 3 format 3, 3 x 2, 0 0 0",
        "oidnNewBuffer 1 72 = 4",
        "oidnSetFilterImage 2 albedo 4 format 3, 3 x 2, 0 0 0",
        "oidnNewBuffer 1 72 = 5",
        "oidnSetFilterImage 2 normal 5 format 3, 3 x 2, 0 0 0",
        "oidnNewBuffer 1 72 = 6",
        "oidnSetFilterImage 2 output 6 format 3, 3 x 2, 0 0 0",
        "oidnSetFilterBool 2 hdr 1",
        "oidnSetFilterBool 2 cleanAux 0",
        "oidnSetFilterInt 2 maxMemoryMB 300",
        "oidnSetFilterFloat 2 inputScale 0.25",
        "oidnCommitFilter 2",
        "oidnWriteBuffer 3 0 72",
        "oidnWriteBuffer 4 0 72",
        "oidnWriteBuffer 5 0 72",
        "oidnExecuteFilter 2",
        "oidnReadBuffer 6 0 72",
        "oidnReleaseFilter 2",
        "oidnReleaseBuffer 3",
        "oidnReleaseBuffer 4",
        "oidnReleaseBuffer 5",
        "oidnReleaseBuffer 6",
        "oidnReleaseDevice 1",
    ];
    assert_eq!(fake.log(), log);
    assert!(fake.faults().is_empty());
}

#[test]
fn layers_that_are_not_there_are_not_set() {
    let (color, albedo) = (layer(1.0), layer(100.0));
    let bare = Image { clean_aux: true, ..Image::new(3, 2, &color) };
    let with_albedo = Image { albedo: Some(&albedo), ..bare };
    for (image, layers) in [(bare, 2), (with_albedo, 3)] {
        let fake = Fake::new(&["TYPE=3"]);
        let device = fake.device().expect("a device");
        assert_eq!(device.kind(), DeviceKind::Cuda);
        let mut out = vec![f32::NAN; 18];
        device.denoise(&image, &mut out).expect("a denoised picture");
        assert_eq!(out, expected(&image));
        drop(device);
        assert_eq!(fake.calls("oidnNewBuffer"), layers);
        assert_eq!(fake.calls("oidnSetFilterImage"), layers);
        assert_eq!(fake.calls("oidnWriteBuffer"), layers - 1);
        let log = fake.log();
        for call in ["Bool 2 hdr 0", "Bool 2 cleanAux 1", "Int 2 maxMemoryMB -1"] {
            assert!(log.contains(&format!("oidnSetFilter{call}")), "{call}: {log:?}");
        }
        assert_eq!(fake.calls("oidnSetFilterFloat"), 0, "the library chooses the scale");
        assert!(fake.faults().is_empty());
    }
}

#[test]
fn pictures_of_one_kind_share_a_filter() {
    let fake = Fake::new(&[]);
    let device = fake.device().expect("a device");
    let denoise = |image: &Image<'_>| {
        let mut out = vec![f32::NAN; image.color.len()];
        device.denoise(image, &mut out).expect("a denoised picture");
        assert_eq!(out, expected(image));
    };
    // Whatever of the values changes.
    for i in 0..5u8 {
        let (color, albedo) = (layer(f32::from(i)), layer(10.0 * f32::from(i)));
        denoise(&Image { albedo: Some(&albedo), ..Image::new(3, 2, &color) });
    }
    let once = ["oidnNewFilter", "oidnCommitFilter"].map(|name| fake.calls(name));
    assert_eq!((once, fake.calls("oidnNewBuffer")), ([1, 1], 3));
    assert_eq!((fake.calls("oidnExecuteFilter"), fake.calls("oidnWriteBuffer")), (5, 10));

    // Whatever of the kind changes.
    let color = layer(1.0);
    let image = Image { albedo: Some(&color), ..Image::new(3, 2, &color) };
    let others = [
        Image { hdr: true, ..image },
        Image { clean_aux: true, ..image },
        Image { input_scale: Some(1.0), ..image },
        Image { normal: Some(&color), ..image },
        Image { albedo: None, ..image },
        Image { width: 2, height: 3, ..image },
    ];
    for (i, other) in others.iter().enumerate() {
        denoise(other);
        assert_eq!(fake.calls("oidnNewFilter"), 2 + 2 * i, "{other:?}");
        denoise(&image);
        assert_eq!(fake.calls("oidnNewFilter"), 3 + 2 * i, "{other:?}");
        // What the last kind needed is released.
        let released = fake.calls("oidnReleaseFilter");
        assert_eq!(released, fake.calls("oidnNewFilter") - 1);
    }
    drop(device);
    assert!(fake.faults().is_empty());
}

/// What is asked of the library is the filter of that kind, which pictures then share.
#[test]
fn pictures_may_be_divided() {
    let fake = Fake::new(&["TILE_ALIGNMENT=8", "TILE_OVERLAP=40"]);
    let device = fake.device().expect("a device");
    let color = layer(1.0);
    let image = Image { albedo: Some(&color), ..Image::new(3, 2, &color) };
    let tiling = device.tiling(&image).expect("what the library says");
    assert_eq!(tiling, Tiling { alignment: 8, overlap: 40 });
    assert_eq!((fake.calls("oidnNewBuffer"), fake.calls("oidnWriteBuffer")), (3, 0));
    device.denoise(&image, &mut [0.0; 18]).expect("a denoised picture");
    assert_eq!(fake.calls("oidnNewFilter"), 1);
    drop(device);
    assert!(fake.faults().is_empty());
    // An alignment of none is one of each pixel.
    let odd = Fake::new(&["TILE_ALIGNMENT=0", "TILE_OVERLAP=-1"]);
    let tiling = odd.device().expect("a device").tiling(&image).expect("what the library says");
    assert_eq!(tiling, Tiling { alignment: 1, overlap: 0 });
}

#[test]
fn threads_may_share_a_device() {
    let fake = Fake::new(&[]);
    let device = fake.device().expect("a device");
    thread::scope(|scope| {
        for begin in [1.0, 100.0, 1000.0, 10_000.0] {
            let device = &device;
            scope.spawn(move || {
                let (color, mut out) = (layer(begin), vec![f32::NAN; 18]);
                let image = Image::new(3, 2, &color);
                for _ in 0..20 {
                    device.denoise(&image, &mut out).expect("a denoised picture");
                    assert_eq!(out, expected(&image));
                }
            });
        }
    });
    drop(device);
    assert_eq!(fake.calls("oidnNewFilter"), 1);
    assert!(fake.faults().is_empty());
}
