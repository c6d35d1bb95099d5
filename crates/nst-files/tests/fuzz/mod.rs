//! What the fuzz tests of files share: an allocator that counts, and random numbers.
//! Each is the only test of its binary, so that nothing else moves the peak.

// A global allocator is unsafe by nature; this one counts, and passes on.
#![allow(unsafe_code)]

use std::{
    alloc::{GlobalAlloc, Layout, System},
    sync::atomic::{AtomicUsize, Ordering::Relaxed},
};

use nst_core::random::SplitMix64;

struct Counting;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator as it is.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        PEAK.fetch_max(LIVE.fetch_add(layout.size(), Relaxed) + layout.size(), Relaxed);
        // SAFETY: the caller keeps the contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// The most that was allocated at once while `work` ran, beyond what was before.
pub(crate) fn peak_of<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let before = LIVE.load(Relaxed);
    PEAK.store(before, Relaxed);
    let result = work();
    (result, PEAK.load(Relaxed) - before)
}

/// One of some values.
pub(crate) fn pick<T: Copy>(random: &mut SplitMix64, from: &[T]) -> T {
    from[random.below(from.len())]
}

/// Numbers at which sizes and counts overflow or change their sign.
pub(crate) const NUMBERS: [u32; 14] = [
    0,
    1,
    2,
    15,
    255,
    0xffff,
    0x1_0000,
    0x10_0000,
    0x7fff_fffe,
    0x7fff_ffff,
    0x8000_0000,
    0x8000_0001,
    0xffff_fff0,
    0xffff_ffff,
];

/// Overwrites four bytes, or what is left of them, with one of [`NUMBERS`].
pub(crate) fn put_number(bytes: &mut [u8], at: usize, random: &mut SplitMix64) {
    let number = pick(random, &NUMBERS).to_le_bytes();
    for (byte, new) in bytes.iter_mut().skip(at).zip(number) {
        *byte = new;
    }
}

/// Damages bytes in a way that has nothing to do with what they mean, at a place before
/// `end`: a flipped bit, another byte, a cut, a part removed or copied elsewhere.
pub(crate) fn damage_blindly(bytes: &mut Vec<u8>, end: usize, random: &mut SplitMix64) {
    let at = random.below(end);
    match random.below(6) {
        0 | 1 => bytes[at] ^= 1 << random.below(8),
        2 => bytes[at] = random.next_u64() as u8,
        3 => bytes.truncate(at),
        4 => drop(bytes.drain(at..bytes.len().min(at + 1 + random.below(30)))),
        _ => {
            let part = bytes[at..bytes.len().min(at + 1 + random.below(30))].to_vec();
            let to = random.below(end);
            bytes.splice(to..to, part);
        }
    }
}
