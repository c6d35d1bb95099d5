//! Open Image Denoise as an expert of the guard.

use std::{
    ops::Range,
    sync::{Mutex, PoisonError},
};

use nst_core::{
    Error as CoreError, Grid, Support,
    guard::{PictureExpert, SeenPicture},
};
use nst_oidn::{Device, Image, Library, Tiling};

use crate::error::Error;

/// What `--experts` calls it.
pub(crate) const NAME: &str = "oidn";

/// The most memory, in MB, that it takes beside pictures and networks.
const MAX_MEMORY: u16 = 300;

/// What the mean of a picture's radiance becomes while it is denoised. By itself, the library
/// brings a geometric mean of what it sees to 0.18; that is mostly somewhat less than the mean,
/// and of parts of a picture it differs.
const MEAN: f64 = 0.25;

/// Open Image Denoise, on the device that it prefers.
///
/// What it says of a pixel depends on the rows around it, as many as the library tells, and
/// on where those begin, as the network halves the picture several times. Strips of any height
/// are given to it so that it says the same of each pixel. On the CPU the bits are the same.
pub(crate) struct Oidn {
    /// Strips that are denoised at the same time would only take more memory.
    device: Mutex<Device>,
    reach: Reach,
}

impl Oidn {
    /// Finds its library and loads it; `None` if there is none. `before` gets each file before
    /// it is loaded: a damaged one may end the process.
    pub(crate) fn find(mut before: impl FnMut(String)) -> Result<Option<Self>, nst_oidn::Error> {
        let library = Library::find(|candidate| before(candidate.to_string()))?;
        let Some(library) = library else { return Ok(None) };
        let device = Device::new(&library)?.with_max_memory(MAX_MEMORY);
        let reach = Reach::of(&device)?;
        Ok(Some(Self { device: Mutex::new(device), reach }))
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

/// On which rows an estimate depends.
#[derive(Clone, Copy)]
struct Reach {
    /// Rows are denoised in blocks of so many, from the top of the picture.
    block: usize,
    /// Further rows on either side of a block, a multiple of it.
    beside: usize,
}

impl Reach {
    /// The farthest for all pictures that a device will get.
    fn of(device: &Device) -> Result<Self, nst_oidn::Error> {
        let layer = [0.0; 3];
        let of = |albedo: bool, normal: bool| {
            let [albedo, normal] = [albedo, normal].map(|is_there| is_there.then_some(&layer[..]));
            device.tiling(&Image { albedo, normal, hdr: true, ..Image::new(1, 1, &layer) })
        };
        let tilings = [of(false, false)?, of(true, false)?, of(true, true)?];
        let farthest = |length: fn(&Tiling) -> u32| tilings.iter().map(length).max().unwrap_or(1);
        // They are powers of two.
        let block = farthest(|tiling| tiling.alignment) as usize;
        let beside = farthest(|tiling| tiling.overlap) as usize;
        Ok(Self { block, beside: beside.next_multiple_of(block) })
    }

    /// How far a pixel may be from the rows that its estimate depends on.
    fn farthest(self) -> usize {
        self.beside + self.block - 1
    }

    /// The rows that estimates of some rows depend on, of those that there are.
    fn around(self, rows: Range<usize>, all: Range<usize>) -> Range<usize> {
        let start = (rows.start / self.block * self.block).saturating_sub(self.beside);
        let end = rows.end.next_multiple_of(self.block) + self.beside;
        start.max(all.start)..end.min(all.end)
    }
}

impl PictureExpert for Oidn {
    fn name(&self) -> &'static str {
        NAME
    }

    fn support(&self) -> Support {
        Support::Radius(self.reach.farthest() as u32)
    }

    fn estimates_emission(&self) -> bool {
        true
    }

    fn estimate(&self, seen: &SeenPicture<'_>, out: &mut [f32]) -> Result<(), CoreError> {
        let grid = seen.grid;
        // Three channels are colours; each of others is denoised as a grey picture.
        let at_once = if grid.channels() == 3 { 3 } else { 1 };
        let means = seen.mean.chunks_exact(at_once * grid.pixels());
        let device = self.device.lock().unwrap_or_else(PoisonError::into_inner);
        for (mean, out) in means.zip(out.chunks_exact_mut(at_once * inner_pixels(grid))) {
            self.denoise(&device, seen, mean, out)?;
        }
        Ok(())
    }
}

impl Oidn {
    /// Denoises the inner rows of one or three planes.
    fn denoise(
        &self,
        device: &Device,
        seen: &SeenPicture<'_>,
        mean: &[f32],
        out: &mut [f32],
    ) -> Result<(), CoreError> {
        let grid = seen.grid;
        let (width, first) = (grid.width(), grid.first_row() as usize);
        let of_grid = first..first + grid.rows();
        let inner = first + grid.inner_rows().start..first + grid.inner_rows().end;
        for (out, mean) in out.iter_mut().zip(grid.inner(mean).iter()) {
            *out = 0.0 * mean;
        }
        // Where all is black as far as it looks, it is not asked.
        let shines = shining_rows(grid, mean);
        let is_lit = |y: &usize| {
            let around = self.reach.around(*y..y + 1, of_grid.clone());
            shines[around.start - first..around.end - first].contains(&true)
        };
        let asked = inner.clone().zip(seen.asked).filter(|(_, asked)| **asked);
        let lit: Vec<usize> = asked.map(|(y, _)| y).filter(is_lit).collect();
        let (Some(&top), Some(&bottom)) = (lit.first(), lit.last()) else { return Ok(()) };
        let rows = self.reach.around(top..bottom + 1, of_grid);
        let (start, pixels) = ((rows.start - first) * width, rows.len() * width);
        // A radiance that is not finite is not denoised, but looks dark to its neighbours.
        let side_by_side = |values: &[f32]| -> Vec<f32> {
            let planes: Vec<&[f32]> = values.chunks_exact(grid.pixels()).collect();
            let plane = |channel: usize| planes[channel.min(planes.len() - 1)];
            let value = |i: usize| finite(plane(i % 3)[start + i / 3]);
            (0..3 * pixels).map(value).collect()
        };
        let albedo = seen.albedo.map(|it| side_by_side(it.mean));
        let normal = seen.normal.filter(|_| albedo.is_some()).map(|it| side_by_side(it.mean));
        let color = side_by_side(mean);
        let scale = (MEAN / seen.unit) as f32;
        let image = Image {
            albedo: albedo.as_deref(),
            normal: normal.as_deref(),
            hdr: true,
            input_scale: Some(scale.clamp(f32::MIN_POSITIVE, f32::MAX)),
            ..Image::new(width, rows.len(), &color)
        };
        let mut denoised = vec![0.0; 3 * pixels];
        let failed = |error: nst_oidn::Error| CoreError::Batch(error.to_string());
        device.denoise(&image, &mut denoised).map_err(failed)?;
        for (channel, out) in out.chunks_exact_mut(inner_pixels(grid)).enumerate() {
            for &y in &lit {
                let out = &mut out[(y - inner.start) * width..][..width];
                let denoised = denoised[3 * (y - rows.start) * width..].chunks_exact(3);
                // What was not finite stays so.
                out.iter_mut().zip(denoised).for_each(|(out, it)| *out += it[channel]);
            }
        }
        Ok(())
    }
}

fn finite(x: f32) -> f32 {
    if x.is_finite() { x } else { 0.0 }
}

/// Whether something shines in the rows of a strip, in any plane.
fn shining_rows(grid: &Grid, planes: &[f32]) -> Vec<bool> {
    let mut shines = vec![false; grid.rows()];
    for plane in planes.chunks_exact(grid.pixels()) {
        for (shines, row) in shines.iter_mut().zip(plane.chunks_exact(grid.width())) {
            *shines |= row.iter().any(|x| finite(*x) != 0.0);
        }
    }
    shines
}

fn inner_pixels(grid: &Grid) -> usize {
    grid.inner_rows().len() * grid.width()
}
