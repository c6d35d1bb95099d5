//! Checks whether a rendering fits into memory, before it begins.

use bytemuck::Zeroable;
use nst_core::{FOLDS, FeatureSums, LaneSums};

use crate::{
    Error,
    settings::{CHANNELS, RenderSettings, Start},
    slots::Slots,
};

/// Bytes that a rendering of a size takes: for each lane its terms and sums, and for each pixel
/// the sums of its features.
pub(crate) fn needed(size: [u32; 2], settings: &RenderSettings) -> u128 {
    let pixels = u128::from(size[0]) * u128::from(size[1]);
    pixels * bytes_per_pixel(settings)
}

fn bytes_per_pixel(settings: &RenderSettings) -> u128 {
    let slots = Slots::new(settings.keep, settings.spp).count() as u128;
    let sums = size_of::<LaneSums>() + settings.powers.count() * size_of::<[f64; FOLDS]>();
    let features = if settings.features { size_of::<FeatureSums>() } else { 0 };
    CHANNELS as u128 * (slots * size_of::<f32>() as u128 + sums as u128) + features as u128
}

/// Bytes of what a rendering is continued from, all of which become a part of it.
pub(crate) fn of_start(Start { batch, sums }: &Start) -> usize {
    let features = sums.features.as_ref().map_or(0, |pixels| size_of_val(&pixels[..]));
    let lanes = size_of_val(&sums.lanes[..]) + size_of_val(sums.powers.sums());
    batch.terms().len() * size_of::<f32>() + lanes + features
}

/// Fails if a rendering needs more memory than is free, before anything is allocated;
/// [`render`](crate::render()) checks this, too.
///
/// # Errors
/// [`Error::Memory`], with what would fit.
pub fn check_memory(size: [u32; 2], settings: &RenderSettings) -> Result<(), Error> {
    check_further(size, settings, 0)
}

/// The same where so many bytes of what the rendering needs are in memory already.
pub(crate) fn check_further(
    size: [u32; 2],
    settings: &RenderSettings,
    present: usize,
) -> Result<(), Error> {
    let Some(free) = free() else { return Ok(()) };
    let available = u128::from(free) + present as u128;
    let needed = needed(size, settings);
    if needed <= available {
        return Ok(());
    }
    let advice = match present {
        0 => advice(size, settings, available),
        _ => {
            let terms = terms(size, settings, available);
            let terms = terms.map_or_else(String::new, |terms| format!("{terms} would fit; "));
            terms + "a rendering that is continued keeps its size and its features"
        }
    };
    Err(Error::Memory { needed: gib(needed), available: gib(available), advice })
}

/// What would fit: a picture of the same shape, or fewer terms, or no features, or else a smaller
/// picture of one term.
fn advice(size: [u32; 2], settings: &RenderSettings, available: u128) -> String {
    let fitting = |settings: &RenderSettings| {
        let pixels = available / bytes_per_pixel(settings);
        let share = (pixels as f64 / (f64::from(size[0]) * f64::from(size[1]))).sqrt();
        size.map(|length| (f64::from(length) * share).floor() as u64)
    };
    let mut ways = Vec::new();
    let [width, height] = fitting(settings);
    if width * height > 0 {
        ways.push(format!("{width}x{height} pixels"));
    }
    ways.extend(terms(size, settings, available));
    let plain = RenderSettings { features: false, ..*settings };
    if settings.features && needed(size, &plain) <= available {
        ways.push("the same without features (as with --experts lane)".into());
    }
    if ways.is_empty() {
        let [width, height] = fitting(&RenderSettings { spp: 1, ..*settings });
        ways.push(format!("{width}x{height} pixels with one stored term each"));
    }
    ways.join(", or ") + " would fit"
}

/// How many terms would fit, if one does.
fn terms(size: [u32; 2], settings: &RenderSettings, available: u128) -> Option<String> {
    let least = RenderSettings { spp: 1, ..*settings };
    let spare = available.checked_sub(needed(size, &least))?;
    Some(format!("{} stored terms of each pixel", 1 + spare / needed_per_term(size)))
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

/// Gives the memory of all elements from a number on back.
pub(crate) fn cut<T>(values: &mut Vec<T>, length: usize) {
    values.truncate(length);
    values.shrink_to_fit();
}

fn gib(bytes: u128) -> String {
    format!("{:.1} GiB", bytes as f64 / f64::from(1_u32 << 30))
}

/// Bytes of memory and of swap space that are free, where the system tells: Linux.
fn free() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let kibibytes = |key: &str| -> Option<u64> {
        let line = text.lines().find(|line| line.starts_with(key))?;
        line.split_whitespace().nth(1)?.parse().ok()
    };
    Some((kibibytes("MemAvailable:")? + kibibytes("SwapFree:").unwrap_or(0)) * 1024)
}

#[cfg(test)]
mod tests {
    use nst_core::{FurtherPowers, Keep};

    use super::*;
    use crate::SamplerKind;

    #[cfg(target_os = "linux")]
    #[test]
    fn what_is_in_memory_is_not_asked_for_again() {
        let settings = RenderSettings {
            spp: 1 << 20,
            sampler: SamplerKind::Random,
            seed: 0,
            keep: Keep::All,
            features: true,
            powers: FurtherPowers::NONE,
        };
        let size = [26_000, 26_000];
        let present = usize::try_from(needed(size, &settings)).expect("64 bits");
        assert!(check_further(size, &settings, present).is_ok());
        let error = check_further(size, &settings, present / 2).expect_err("petabytes");
        assert!(error.to_string().ends_with("keeps its size and its features"), "{error}");
    }

    /// In 128 MiB; a lane takes 4 bytes for each term, and 96 for its sums; features take 296 bytes
    /// of a pixel.
    #[test]
    fn what_would_fit_is_neither_nothing_nor_too_much() {
        for (size, spp, features, expected) in [
            ([4000, 1000], 8, false, "1182x295 pixels would fit"),
            (
                [16, 16],
                2_000_000,
                false,
                "2x2 pixels, or 43666 stored terms of each pixel would fit",
            ),
            ([16, 16], 4_000_000_000, false, "43666 stored terms of each pixel would fit"),
            (
                [16000, 16000],
                4_000_000_000,
                false,
                "668x668 pixels with one stored term each would fit",
            ),
            (
                [500, 500],
                8,
                true,
                "444x444 pixels, or the same without features (as with --experts lane) would fit",
            ),
            // 384 bytes of each pixel without them.
            ([592, 592], 8, true, "444x444 pixels would fit"),
        ] {
            let settings = RenderSettings {
                spp,
                sampler: SamplerKind::Random,
                seed: 0,
                keep: Keep::All,
                features,
                powers: FurtherPowers::NONE,
            };
            assert_eq!(advice(size, &settings, 1 << 27), expected);
        }
    }
}
