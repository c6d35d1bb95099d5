//! Numbers that several kinds of files share.

/// Rows that are compressed together in the files of this crate, as in all EXR files with
/// ZIP compression; other blocks of scan lines have this height or a divisor of it.
pub(crate) const BLOCK_ROWS: u32 = 16;

/// How much of a sequence is worked on at a time, in bytes: enough blocks for many
/// threads, and little beside a whole rendering.
pub(crate) const STRIP_BYTES: usize = 128 << 20;

/// Deflate stores at most 258 bytes in two bits (RFC 1951): no lossless block of EXR is
/// smaller than this fraction of its pixels.
pub(crate) const MOST_DEFLATED: u64 = 1032;

/// A number of rows, a multiple of [`BLOCK_ROWS`], that take up about [`STRIP_BYTES`].
pub(crate) fn strip_rows(row_bytes: usize) -> u32 {
    let blocks = STRIP_BYTES / row_bytes.saturating_mul(BLOCK_ROWS as usize).max(1);
    // Pictures have less than 2^31 rows.
    BLOCK_ROWS * (blocks.clamp(1, 1 << 20) as u32)
}
