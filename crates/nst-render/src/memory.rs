//! Checks whether a rendering fits into memory, before it begins.

use bytemuck::Zeroable;
use nst_core::LaneSums;

use crate::{
    Error,
    rendering::{CHANNELS, RenderSettings},
    slots::Slots,
};

/// Bytes that a rendering of a size keeps: the terms and the sums of each lane. Side
/// channels are made at the end, when the memory of the tracer is free again.
pub(crate) fn needed(size: [u32; 2], settings: &RenderSettings) -> u128 {
    let pixels = u128::from(size[0]) * u128::from(size[1]);
    pixels * bytes_per_pixel(settings)
}

fn bytes_per_pixel(settings: &RenderSettings) -> u128 {
    let slots = Slots::new(settings.keep, settings.spp).count() as u128;
    CHANNELS as u128 * (slots * size_of::<f32>() as u128 + size_of::<LaneSums>() as u128)
}

/// Fails if a rendering needs more memory than is free.
pub(crate) fn check(size: [u32; 2], settings: &RenderSettings) -> Result<(), Error> {
    let Some(available) = available() else { return Ok(()) };
    let needed = needed(size, settings);
    if needed <= u128::from(available) {
        return Ok(());
    }
    let pixels = u128::from(available) / bytes_per_pixel(settings);
    // The largest picture of the same shape.
    let share = (pixels as f64 / (f64::from(size[0]) * f64::from(size[1]))).sqrt();
    let [width, height] = size.map(|length| (f64::from(length) * share).floor() as u64);
    let mut advice = format!("{width}x{height} pixels would fit");
    let least = RenderSettings { spp: 1, ..*settings };
    if self::needed(size, &least) <= u128::from(available) {
        let spare = u128::from(available) - self::needed(size, &least);
        let plane = needed_per_term(size);
        advice += &format!(", or {} stored terms of each pixel", 1 + spare / plane);
    }
    Err(Error::Memory { needed: gib(needed), available: gib(available.into()), advice })
}

fn needed_per_term(size: [u32; 2]) -> u128 {
    u128::from(size[0]) * u128::from(size[1]) * (CHANNELS * size_of::<f32>()) as u128
}

/// Zeros that take no memory before they are written to.
pub(crate) fn zeros<T: Zeroable>(count: usize, needed: u128) -> Result<Vec<T>, Error> {
    bytemuck::allocation::try_zeroed_vec(count).map_err(|()| Error::Memory {
        needed: gib(needed),
        available: "less".into(),
        advice: "a smaller picture, or fewer stored terms, may fit".into(),
    })
}

fn gib(bytes: u128) -> String {
    format!("{:.1} GiB", bytes as f64 / f64::from(1_u32 << 30))
}

/// Bytes of memory and of swap space that are free, where the system tells: Linux.
fn available() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let kibibytes = |key: &str| -> Option<u64> {
        let line = text.lines().find(|line| line.starts_with(key))?;
        line.split_whitespace().nth(1)?.parse().ok()
    };
    Some((kibibytes("MemAvailable:")? + kibibytes("SwapFree:").unwrap_or(0)) * 1024)
}
