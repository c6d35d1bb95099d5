//! Open Image Denoise as an expert of the guard.

use nst_core::{
    Error as CoreError, Support,
    guard::{PictureExpert, SeenPicture},
};
use nst_oidn::{Device, Image, Library};

use crate::error::Error;

/// What `--experts` calls it.
pub(crate) const NAME: &str = "oidn";

/// Open Image Denoise, on the device that it prefers.
pub(crate) struct Oidn {
    device: Device,
}

impl Oidn {
    /// Finds its library and loads it; `None` if there is none. `before` gets each file before
    /// it is loaded: a damaged one may end the process.
    pub(crate) fn find(mut before: impl FnMut(String)) -> Result<Option<Self>, nst_oidn::Error> {
        let library = Library::find(|candidate| before(candidate.to_string()))?;
        let device = library.map(|library| Device::new(&library)).transpose()?;
        Ok(device.map(|device| Self { device }))
    }

    /// The same where it was asked for by its name.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is none, or if it cannot be loaded.
    pub(crate) fn named(before: impl FnMut(String)) -> Result<Self, Error> {
        let found = Self::find(before)
            .map_err(|error| Error::Usage(format!("--experts {NAME}: {error}")))?;
        found.ok_or_else(|| {
            Error::Usage(format!(
                "--experts {NAME}: there is no library of Open Image Denoise 2; install it, or the \
                 Python package 'pyoidn', or set OIDN_LIBRARY to its file"
            ))
        })
    }
}

impl PictureExpert for Oidn {
    fn name(&self) -> &'static str {
        NAME
    }

    fn support(&self) -> Support {
        Support::Picture
    }

    fn estimates_emission(&self) -> bool {
        std::env::var("OE").is_ok()
    }

    fn estimate(&self, seen: &SeenPicture<'_>, out: &mut [f32]) -> Result<(), CoreError> {
        let (width, height, pixels) = (seen.grid.width(), seen.grid.rows(), seen.grid.pixels());
        // A radiance that is not finite is not denoised, but looks dark to its neighbours.
        let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
        let side_by_side = |planes: [&[f32]; 3]| -> Vec<f32> {
            (0..3 * pixels).map(|i| finite(planes[i % 3][i / 3])).collect()
        };
        let planes_of = |values: &'_ [f32]| -> Vec<f32> {
            let plane = |channel: usize| {
                let first = (channel * pixels).min(values.len() - pixels);
                &values[first..first + pixels]
            };
            side_by_side([plane(0), plane(1), plane(2)])
        };
        let albedo = seen.albedo.map(|it| planes_of(it.mean));
        let normal = seen.normal.filter(|_| albedo.is_some()).map(|it| planes_of(it.mean));
        let channels = seen.grid.channels();
        // Three channels are colours; each of others is denoised as a grey picture.
        let at_once = if channels == 3 { 3 } else { 1 };
        let mut denoised = vec![0.0; 3 * pixels];
        for (mean, out) in
            seen.mean.chunks_exact(at_once * pixels).zip(out.chunks_exact_mut(at_once * pixels))
        {
            let color = planes_of(mean);
            let image = Image {
                albedo: albedo.as_deref(),
                normal: normal.as_deref(),
                hdr: true,
                ..Image::new(width, height, &color)
            };
            let failed = |error: nst_oidn::Error| CoreError::Batch(error.to_string());
            self.device.denoise(&image, &mut denoised).map_err(failed)?;
            for (i, out) in out.iter_mut().enumerate() {
                let unknown = 0.0 * mean[i];
                *out = denoised[3 * (i % pixels) + i / pixels] + unknown;
            }
        }
        Ok(())
    }
}
