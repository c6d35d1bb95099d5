//! The loops of the filter, over packets of pixels.

use std::array::from_fn;

use rayon::prelude::*;

use super::planes::{NOISE, OF_CHANNEL, PACKET, Planes, RADIUS, ROOT};
#[cfg(target_arch = "x86_64")]
use crate::vector::{Eight, Sixteen};
use crate::vector::{Four, Instructions, Vector};

/// σ of the distance, in pixels.
const DISTANCE: f32 = 5.0;

/// Columns and rows of a block, whose planes with those around stay in the cache.
const BLOCK: [usize; 2] = [128, 16];

#[repr(align(64))]
struct Packet([f32; PACKET]);

/// A pixel near another one.
#[derive(Clone, Copy)]
struct Tap {
    x: isize,
    y: isize,
    /// s/8 − 1 by the distance.
    far: f32,
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
            Tap { x, y, far: distance / 8.0 - 1.0 }
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
                #[allow(unsafe_code)]
                // SAFETY: any processor has them.
                Instructions::Portable => unsafe { self.of_channels::<Four>(first, &mut rows) },
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
    #[target_feature(enable = "avx2,fma")]
    fn run_avx2(&self, first: usize, rows: &mut Rows<'_>) {
        #[allow(unsafe_code)]
        // SAFETY: this runs where the processor has what it is compiled for.
        unsafe {
            self.of_channels::<Eight>(first, rows);
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx2,fma")]
    fn run_avx512(&self, first: usize, rows: &mut Rows<'_>) {
        #[allow(unsafe_code)]
        // SAFETY: as above.
        unsafe {
            self.of_channels::<Sixteen>(first, rows);
        }
    }

    /// Three channels are tested together. Of other numbers, each is filtered by itself.
    ///
    /// # Safety
    /// The processor has the instructions of `V`; so for the functions below.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn of_channels<V: Vector>(&self, first: usize, rows: &mut Rows<'_>) {
        // SAFETY: the caller's promise.
        unsafe {
            if let [red, green, blue] = &mut rows[..] {
                self.of_guides::<V, 3>(0, first, &mut [red, green, blue]);
            } else {
                for (channel, rows) in rows.iter_mut().enumerate() {
                    self.of_guides::<V, 1>(channel, first, &mut [rows]);
                }
            }
        }
    }

    /// No guides, albedo or normal, or both.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn of_guides<V: Vector, const C: usize>(
        &self,
        channel: usize,
        first: usize,
        rows: &mut [&mut [f32]; C],
    ) {
        // SAFETY: the caller's promise.
        unsafe {
            match self.planes.guides {
                0 => self.block::<V, C, 0>(channel, first, rows),
                3 => self.block::<V, C, 3>(channel, first, rows),
                6 => self.block::<V, C, 6>(channel, first, rows),
                other => unreachable!("{other} guides"),
            }
        }
    }

    /// Filters some rows from row `first` on, of C channels from `channel` on, with G guides.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn block<V: Vector, const C: usize, const G: usize>(
        &self,
        channel: usize,
        first: usize,
        rows: &mut [&mut [f32]; C],
    ) {
        let width = self.planes.grid.width();
        let count = rows[0].len() / width;
        for left in (0..width).step_by(BLOCK[0]) {
            for y in 0..count {
                for x in (left..width.min(left + BLOCK[0])).step_by(V::LANES) {
                    // SAFETY: the caller's promise, and the pixel is one of the planes.
                    let packet = unsafe { self.packet::<V, C, G>(channel, x, first + y) };
                    for (rows, values) in rows.iter_mut().zip(packet) {
                        let place = &mut rows[y * width..][x..width.min(x + V::LANES)];
                        place.copy_from_slice(&values.0[..place.len()]);
                    }
                }
            }
        }
    }

    /// Filters a packet that begins with this pixel.
    ///
    /// # Safety
    /// Also, the pixel is one of the planes.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn packet<V: Vector, const C: usize, const G: usize>(
        &self,
        channel: usize,
        x: usize,
        y: usize,
    ) -> [Packet; C] {
        let Planes { ref grid, stride, ref values, .. } = *self.planes;
        let of_row = self.planes.of_row();
        let of_channel = OF_CHANNEL * stride;
        let [first, guides] = [channel, grid.channels()].map(|channel| channel * of_channel);
        let load = |place: usize| {
            debug_assert!(place + V::LANES <= values.len());
            // SAFETY: the caller's promise. With the tap's column, a packet is in its row of a
            // plane, which has `RADIUS` columns more on either side and whole packets.
            unsafe { V::load_anywhere(values.as_ptr().add(place)) }
        };
        // SAFETY: the caller's promise.
        unsafe {
            let here = y * of_row + RADIUS as usize + x;
            let [zero, minus, huge] = [0.0, -1.0, f32::MAX].map(|value| V::splat(value));
            let own_roots: [V; C] =
                from_fn(|c| minus.mul(load(here + first + c * of_channel + ROOT * stride)));
            let own_noises: [V; C] =
                from_fn(|c| load(here + first + c * of_channel + NOISE * stride));
            let own_guides: [V; G] = from_fn(|g| minus.mul(load(here + guides + g * stride)));
            let own_guide_noise = if G > 0 { load(here + guides + G * stride) } else { zero };
            let mut sums = [zero; C];
            let mut total = zero;
            for tap in &self.taps {
                let Some(row) = y.checked_add_signed(tap.y).filter(|row| *row < grid.rows()) else {
                    continue;
                };
                let there = (row * of_row + RADIUS as usize + x).wrapping_add_signed(tap.x);
                let mut far = V::splat(tap.far);
                if G > 0 {
                    // What may be noise does not tell pixels apart.
                    let mut differ = own_guide_noise.add(load(there + guides + G * stride));
                    for (g, own) in own_guides.iter().enumerate() {
                        let d = own.add(load(there + guides + g * stride));
                        differ = d.mul_add(d, differ);
                    }
                    far = far.add(differ.max(zero));
                }
                let excesses: [V; C] = from_fn(|c| {
                    let channel = there + first + c * of_channel;
                    let d = own_roots[c].add(load(channel + ROOT * stride));
                    let noise = own_noises[c].add(load(channel + NOISE * stride));
                    d.mul_add(d, noise)
                });
                let excess = excesses[1..].iter().fold(excesses[0], |most, next| most.max(*next));
                // At most −1, which s/8 − 1 is at least, up to an excess of 0; else above 0.
                let apart = excess.mul_add(huge, minus);
                let near = far.max(apart).min(zero);
                let square = near.mul(near);
                let fourth = square.mul(square);
                let weight = fourth.mul(fourth);
                total = total.add(weight);
                for (c, sum) in sums.iter_mut().enumerate() {
                    *sum = weight.mul_add(load(there + first + c * of_channel), *sum);
                }
            }
            let mut totals = Packet([0.0; PACKET]);
            total.store(totals.0.as_mut_ptr());
            from_fn(|c| {
                let mut values = Packet([0.0; PACKET]);
                sums[c].store(values.0.as_mut_ptr());
                // 0/0 where the pixel does not count.
                values.0.iter_mut().zip(totals.0).for_each(|(value, total)| *value /= total);
                values
            })
        }
    }
}
