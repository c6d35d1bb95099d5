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

/// Packets, one above the other, that are filtered together. Most of the time goes to loads of
/// what is around, which begin anywhere; these have nearly all of it in common.
const TOGETHER: usize = 2;

#[derive(Clone, Copy)]
#[repr(align(64))]
struct Packet([f32; PACKET]);

/// A pixel near at least one of those that are filtered together.
#[derive(Clone, Copy)]
struct Tap {
    /// From the first of them.
    x: isize,
    y: isize,
    /// s/8 − 1 by the distance from each; 0 where it is not near, so that its weight is.
    far: [f32; TOGETHER],
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
        let rows = -reach..reach + TOGETHER as isize;
        let around = rows.flat_map(|y| (-reach..=reach).map(move |x| (x, y)));
        let far = |x: isize, y: isize| {
            let square = x * x + y * y;
            let distance = square as f32 / (2.0 * DISTANCE * DISTANCE);
            if square <= reach * reach { distance / 8.0 - 1.0 } else { 0.0 }
        };
        let tap = |(x, y)| Tap { x, y, far: from_fn(|row| far(x, y - row as isize)) };
        let taps = around.map(tap).filter(|tap| tap.far != [0.0; TOGETHER]);
        Self { planes, taps: taps.collect() }
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
            for y in (0..count).step_by(TOGETHER) {
                for x in (left..width.min(left + BLOCK[0])).step_by(V::LANES) {
                    // SAFETY: the caller's promise, and the pixel is one of the planes.
                    let packets = unsafe { self.packets::<V, C, G>(channel, x, first + y) };
                    for (y, packets) in (y..count).zip(packets) {
                        for (rows, values) in rows.iter_mut().zip(packets) {
                            let place = &mut rows[y * width..][x..width.min(x + V::LANES)];
                            place.copy_from_slice(&values.0[..place.len()]);
                        }
                    }
                }
            }
        }
    }

    /// Filters packets that begin with this pixel and with those below it; one that would lie
    /// below the planes gets some numbers.
    ///
    /// # Safety
    /// Also, the pixel is one of the planes.
    #[allow(unsafe_code)]
    #[inline(always)]
    unsafe fn packets<V: Vector, const C: usize, const G: usize>(
        &self,
        channel: usize,
        x: usize,
        y: usize,
    ) -> [[Packet; C]; TOGETHER] {
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
        // Loops instead of closures: the compiler calls vector instructions of nested closures as
        // functions.
        // SAFETY: the caller's promise.
        unsafe {
            let (zero, minus, huge) = (V::splat(0.0), V::splat(-1.0), V::splat(f32::MAX));
            let minus_two = V::splat(-2.0);
            let mut own_roots = [[zero; C]; TOGETHER];
            let mut own_noises = [[zero; C]; TOGETHER];
            let mut own_guides = [[zero; G]; TOGETHER];
            let mut own_guide_noise = [zero; TOGETHER];
            for row in 0..TOGETHER {
                let here = (y + row).min(grid.rows() - 1) * of_row + RADIUS as usize + x;
                for c in 0..C {
                    let channel = here + first + c * of_channel;
                    own_roots[row][c] = minus.mul(load(channel + ROOT * stride));
                    own_noises[row][c] = load(channel + NOISE * stride);
                }
                for g in 0..G {
                    own_guides[row][g] = minus_two.mul(load(here + guides + g * stride));
                }
                if G > 0 {
                    own_guide_noise[row] = load(here + guides + G * stride);
                }
            }
            let mut sums = [[zero; C]; TOGETHER];
            let mut total = [zero; TOGETHER];
            for tap in &self.taps {
                let Some(row) = y.checked_add_signed(tap.y).filter(|row| *row < grid.rows()) else {
                    continue;
                };
                let there = (row * of_row + RADIUS as usize + x).wrapping_add_signed(tap.x);
                let mut far = [zero; TOGETHER];
                for row in 0..TOGETHER {
                    far[row] = V::splat(tap.far[row]);
                }
                if G > 0 {
                    // What may be noise does not tell pixels apart.
                    let noise = load(there + guides + G * stride);
                    let mut differ = [zero; TOGETHER];
                    for row in 0..TOGETHER {
                        differ[row] = own_guide_noise[row].add(noise);
                    }
                    for g in 0..G {
                        let guide = load(there + guides + g * stride);
                        for row in 0..TOGETHER {
                            differ[row] = own_guides[row][g].mul_add(guide, differ[row]);
                        }
                    }
                    for row in 0..TOGETHER {
                        far[row] = far[row].add(differ[row].max(zero));
                    }
                }
                let mut excess = [zero; TOGETHER];
                for c in 0..C {
                    let channel = there + first + c * of_channel;
                    let root = load(channel + ROOT * stride);
                    let noise = load(channel + NOISE * stride);
                    for row in 0..TOGETHER {
                        let d = own_roots[row][c].add(root);
                        let of_channel = d.mul_add(d, own_noises[row][c].add(noise));
                        excess[row] = if c == 0 { of_channel } else { excess[row].max(of_channel) };
                    }
                }
                let mut weight = [zero; TOGETHER];
                for row in 0..TOGETHER {
                    // At most −1, which s/8 − 1 is at least, up to an excess of 0; else above 0.
                    let apart = excess[row].mul_add(huge, minus);
                    let near = far[row].max(apart).min(zero);
                    let square = near.mul(near);
                    let fourth = square.mul(square);
                    weight[row] = fourth.mul(fourth);
                    total[row] = total[row].add(weight[row]);
                }
                for c in 0..C {
                    let mean = load(there + first + c * of_channel);
                    for row in 0..TOGETHER {
                        sums[row][c] = weight[row].mul_add(mean, sums[row][c]);
                    }
                }
            }
            let mut packets = [[Packet([0.0; PACKET]); C]; TOGETHER];
            for row in 0..TOGETHER {
                let mut totals = Packet([0.0; PACKET]);
                total[row].store(totals.0.as_mut_ptr());
                for c in 0..C {
                    let values = &mut packets[row][c].0;
                    sums[row][c].store(values.as_mut_ptr());
                    // 0/0 where the pixel does not count.
                    values.iter_mut().zip(totals.0).for_each(|(value, total)| *value /= total);
                }
            }
            packets
        }
    }
}
