//! The loops of the filter, over packets of pixels.

use rayon::prelude::*;

use super::{
    DISTANCE, RADIUS,
    planes::{OF_CHANNEL, Planes},
};
use crate::Instructions;

/// Pixels that are filtered at the same time: a register of AVX-512, or several of others.
pub(super) const PACKET: usize = 16;

/// Columns and rows of a block, whose planes with those around stay in the cache.
const BLOCK: [usize; 2] = [128, 16];

type Packet = [f32; PACKET];

/// A pixel near another one.
#[derive(Clone, Copy)]
struct Tap {
    x: isize,
    y: isize,
    /// 1 − s/8 by the distance.
    near: f32,
}

/// The filter at work on planes.
pub(super) struct Kernel<'a> {
    planes: &'a Planes,
    taps: Vec<Tap>,
}

/// Some rows of each channel of the result.
type Rows<'a> = Vec<&'a mut [f32]>;

impl<'a> Kernel<'a> {
    pub(super) fn new(planes: &'a Planes) -> Self {
        let reach = RADIUS as isize;
        let square = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (x, y)));
        let disc = square.filter(|(x, y)| x * x + y * y <= reach * reach);
        let tap = |(x, y): (isize, isize)| {
            let distance = (x * x + y * y) as f32 / (2.0 * DISTANCE * DISTANCE);
            Tap { x, y, near: 1.0 - distance / 8.0 }
        };
        Self { planes, taps: disc.map(tap).collect() }
    }

    /// Writes the inner rows, `[channel][pixel]`.
    pub(super) fn run(&self, instructions: Instructions, out: &mut [f32]) {
        let grid = &self.planes.grid;
        let (width, inner) = (grid.width(), grid.inner_rows());
        // `[block of rows][channel]`
        let mut blocks: Vec<Rows<'_>> = Vec::new();
        for plane in out.chunks_exact_mut(inner.len() * width) {
            let parts = plane.chunks_mut(BLOCK[1] * width);
            blocks.resize_with(parts.len(), Vec::new);
            blocks.iter_mut().zip(parts).for_each(|(block, part)| block.push(part));
        }
        let blocks = blocks.into_par_iter().enumerate();
        blocks.for_each(|(number, mut rows)| {
            let first = inner.start + number * BLOCK[1];
            match instructions {
                Instructions::Portable => self.of_channels(first, &mut rows),
                #[cfg(target_arch = "x86_64")]
                #[allow(unsafe_code)]
                // SAFETY: instructions are made by detection alone.
                Instructions::Avx2 => unsafe { self.run_avx2(first, &mut rows) },
                #[cfg(target_arch = "x86_64")]
                #[allow(unsafe_code)]
                // SAFETY: as above.
                Instructions::Avx512 => unsafe { self.run_avx512(first, &mut rows) },
            }
        });
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn run_avx2(&self, first: usize, rows: &mut Rows<'_>) {
        self.of_channels(first, rows);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f")]
    fn run_avx512(&self, first: usize, rows: &mut Rows<'_>) {
        self.of_channels(first, rows);
    }

    /// Three channels are tested together. Of other numbers, each is filtered by itself.
    #[inline(always)]
    fn of_channels(&self, first: usize, rows: &mut Rows<'_>) {
        if let [red, green, blue] = &mut rows[..] {
            self.of_guides::<3>(0, first, &mut [red, green, blue]);
        } else {
            for (channel, rows) in rows.iter_mut().enumerate() {
                self.of_guides::<1>(channel, first, &mut [rows]);
            }
        }
    }

    /// No guides, albedo or normal, or both.
    #[inline(always)]
    fn of_guides<const C: usize>(&self, channel: usize, first: usize, rows: &mut [&mut [f32]; C]) {
        match self.planes.guides {
            0 => self.block::<C, 0>(channel, first, rows),
            3 => self.block::<C, 3>(channel, first, rows),
            6 => self.block::<C, 6>(channel, first, rows),
            other => unreachable!("{other} guides"),
        }
    }

    /// Filters some rows from row `first` on, of C channels from `channel` on, with G guides.
    #[inline(always)]
    fn block<const C: usize, const G: usize>(
        &self,
        channel: usize,
        first: usize,
        rows: &mut [&mut [f32]; C],
    ) {
        let width = self.planes.grid.width();
        let count = rows[0].len() / width;
        for left in (0..width).step_by(BLOCK[0]) {
            for y in 0..count {
                for x in (left..width.min(left + BLOCK[0])).step_by(PACKET) {
                    let packet = self.packet::<C, G>(channel, x, first + y);
                    for (rows, values) in rows.iter_mut().zip(packet) {
                        let place = &mut rows[y * width..][x..width.min(x + PACKET)];
                        place.copy_from_slice(&values[..place.len()]);
                    }
                }
            }
        }
    }

    /// Filters a packet that begins with this pixel.
    #[inline(always)]
    fn packet<const C: usize, const G: usize>(
        &self,
        channel: usize,
        x: usize,
        y: usize,
    ) -> [Packet; C] {
        let Planes { grid, stride, .. } = *self.planes;
        let of_row = self.planes.count() * stride;
        let (of_channel, guides) = (OF_CHANNEL * stride, OF_CHANNEL * grid.channels() * stride);
        let here = y * of_row + RADIUS as usize + x;
        let root = |place: usize, c: usize| self.load(place + (channel + c) * of_channel + stride);
        let noise =
            |place: usize, c: usize| self.load(place + (channel + c) * of_channel + 2 * stride);
        let guide = |place: usize, g: usize| self.load(place + guides + g * stride);
        let mean = |place: usize, c: usize| self.load(place + (channel + c) * of_channel);

        let roots: [Packet; C] = std::array::from_fn(|c| *root(here, c));
        let noises: [Packet; C] = std::array::from_fn(|c| *noise(here, c));
        let own: [Packet; G] = std::array::from_fn(|g| *guide(here, g));
        let mut sums = [[0.0; PACKET]; C];
        let mut total = [0.0; PACKET];
        for tap in &self.taps {
            let Some(row) = y.checked_add_signed(tap.y).filter(|row| *row < grid.rows()) else {
                continue;
            };
            let there = (row * of_row + RADIUS as usize + x).wrapping_add_signed(tap.x);
            let mut near = [tap.near; PACKET];
            for g in 0..G {
                let guide = guide(there, g);
                for i in 0..PACKET {
                    let d = own[g][i] - guide[i];
                    near[i] -= d * d;
                }
            }
            let mut weight = [0.0; PACKET];
            for i in 0..PACKET {
                let near = if near[i] > 0.0 { near[i] } else { 0.0 };
                let square = near * near;
                let fourth = square * square;
                weight[i] = fourth * fourth;
            }
            for c in 0..C {
                let (root, noise) = (root(there, c), noise(there, c));
                for i in 0..PACKET {
                    let d = roots[c][i] - root[i];
                    let alike = d * d <= noises[c][i] + noise[i];
                    weight[i] = if alike { weight[i] } else { 0.0 };
                }
            }
            for i in 0..PACKET {
                total[i] += weight[i];
            }
            for c in 0..C {
                let mean = mean(there, c);
                for i in 0..PACKET {
                    sums[c][i] += weight[i] * mean[i];
                }
            }
        }
        for sums in &mut sums {
            for i in 0..PACKET {
                // 0/0 where the pixel does not count.
                sums[i] /= total[i];
            }
        }
        sums
    }

    #[inline(always)]
    fn load(&self, place: usize) -> &Packet {
        self.planes.values[place..place + PACKET].as_array().expect("a packet")
    }
}
