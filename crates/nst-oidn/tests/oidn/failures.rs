//! What happens where the library fails, or is used badly.

use nst_oidn::Image;

use crate::{calls::layer, fake::Fake};

/// What the fake says of a call that failed.
const WHY: &str = "it fell on the floor (error 4)";

/// Denoises a picture with all layers, and asks how it could be divided.
fn denoise(device: &nst_oidn::Device) -> Result<(), String> {
    let color = layer(1.0);
    let layers = Some(color.as_slice());
    let input_scale = Some(1.0);
    let image = Image { albedo: layers, normal: layers, input_scale, ..Image::new(3, 2, &color) };
    let denoised = device.denoise(&image, &mut [0.0; 18]);
    denoised.and_then(|()| device.tiling(&image)).map(drop).map_err(|error| error.to_string())
}

#[test]
fn a_failing_device_is_an_error() {
    let calls = ["oidnNewDevice", "oidnCommitDevice", "oidnGetDeviceInt"];
    let second = ("oidnGetDeviceInt", 2);
    for (function, at) in calls.map(|function| (function, 1)).into_iter().chain([second]) {
        let fake = Fake::new(&[&format!("FAIL=\"{function}\""), &format!("FAIL_AT={at}")]);
        let error = fake.device().expect_err("no device").to_string();
        let begin = format!("'{}' has no device: {WHY}; ", fake.path().display());
        assert!(error.starts_with(&begin), "{error}");
        assert!(fake.faults().is_empty(), "{function}: {:?}", fake.faults());
    }
}

#[test]
fn an_error_may_lack_its_message_and_a_failure_its_error() {
    for (how, says) in [(1, "it does not say why"), (2, WHY), (3, "error 4")] {
        let fake = Fake::new(&["FAIL=\"oidnNewDevice\"", &format!("HOW={how}")]);
        let error = fake.device().expect_err("no device").to_string();
        assert!(error.contains(&format!("has no device: {says};")), "{error}");
        assert!(fake.faults().is_empty(), "{how}: {:?}", fake.faults());
    }
}

/// A function that fails at this call, and what then failed.
const STEPS: [(&str, usize, &str); 21] = [
    ("oidnNewFilter", 1, "make a filter"),
    ("oidnNewBuffer", 1, "allocate memory for a picture"),
    ("oidnNewBuffer", 2, "allocate memory for a picture"),
    ("oidnNewBuffer", 3, "allocate memory for a picture"),
    ("oidnNewBuffer", 4, "allocate memory for a picture"),
    ("oidnSetFilterImage", 1, "give the filter a picture"),
    ("oidnSetFilterImage", 2, "give the filter a picture"),
    ("oidnSetFilterImage", 3, "give the filter a picture"),
    ("oidnSetFilterImage", 4, "give the filter a picture"),
    ("oidnSetFilterBool", 1, "set an option"),
    ("oidnSetFilterBool", 2, "set an option"),
    ("oidnSetFilterInt", 1, "limit its memory"),
    ("oidnSetFilterFloat", 1, "set the scale"),
    ("oidnCommitFilter", 1, "prepare the filter"),
    ("oidnWriteBuffer", 1, "copy a picture to the device"),
    ("oidnWriteBuffer", 2, "copy a picture to the device"),
    ("oidnWriteBuffer", 3, "copy a picture to the device"),
    ("oidnExecuteFilter", 1, "denoise"),
    ("oidnReadBuffer", 1, "copy the picture from the device"),
    ("oidnGetFilterInt", 1, "say how pictures are divided"),
    ("oidnGetFilterInt", 2, "say how pictures are divided"),
];

#[test]
fn every_failing_call_is_an_error_and_the_next_picture_is_denoised() {
    for (function, at, action) in STEPS {
        let fake = Fake::new(&[&format!("FAIL=\"{function}\""), &format!("FAIL_AT={at}")]);
        let device = fake.device().expect("a device");
        let expected = format!("'{}' failed to {action}: {WHY}", fake.path().display());
        assert_eq!(denoise(&device), Err(expected), "{function}, call {at}");
        assert_eq!(denoise(&device), Ok(()), "after {function}, call {at}");
        // With a filter of its own: who knows what state the other is in.
        let filters =
            if function == "oidnNewFilter" { "oidnReleaseDevice" } else { "oidnReleaseFilter" };
        let released = fake.calls(filters);
        assert_eq!(released, usize::from(function != "oidnNewFilter"), "{function}, call {at}");
        drop(device);
        assert!(fake.faults().is_empty(), "{function}, call {at}: {:?}", fake.faults());
    }
}

#[test]
fn objects_may_be_missing_without_an_error_or_come_with_one() {
    for (how, says) in [(1, "it does not say why"), (2, WHY)] {
        for (function, action) in
            [("oidnNewFilter", "make a filter"), ("oidnNewBuffer", "allocate memory for a picture")]
        {
            let fake = Fake::new(&[&format!("FAIL=\"{function}\""), &format!("HOW={how}")]);
            let device = fake.device().expect("a device");
            let error = denoise(&device).expect_err("nothing to denoise with");
            assert!(error.ends_with(&format!("failed to {action}: {says}")), "{error}");
            assert_eq!(denoise(&device), Ok(()));
            drop(device);
            assert!(fake.faults().is_empty(), "{function}: {:?}", fake.faults());
        }
    }
}

#[test]
fn what_is_not_finite_is_not_returned() {
    let fake = Fake::new(&["RUBBISH"]);
    let device = fake.device().expect("a device");
    let says = format!("'{}' returned 4 values that are not finite", fake.path().display());
    assert_eq!(denoise(&device), Err(says));
    drop(device);
    assert!(fake.faults().is_empty());
}

/// `src/image.rs` has the tests of what is wrong with a picture.
#[test]
fn the_library_sees_no_bad_picture() {
    let fake = Fake::new(&[]);
    let device = fake.device().expect("a device");
    let before = fake.log();
    let (color, bad) = (layer(1.0), [f32::NAN; 18]);
    let image = Image::new(3, 2, &color);
    let images = [
        Image { width: 4, ..image },
        Image { height: 0, ..image },
        Image { input_scale: Some(-1.0), ..image },
        Image { color: &bad, ..image },
        Image { normal: Some(&color), ..image },
        Image { albedo: Some(&color[3..]), ..image },
    ];
    for image in images {
        device.denoise(&image, &mut [0.0; 18]).expect_err("a bad picture");
    }
    device.denoise(&image, &mut [0.0; 17]).expect_err("too little space");
    device.tiling(&Image { height: 1, ..image }).expect_err("too much of it");
    assert_eq!(fake.log(), before);
}
