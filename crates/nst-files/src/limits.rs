//! Sizes that the readers and writers of several kinds of files share.

/// Rows that an EXR file compresses together with ZIP compression, in which this crate
/// writes its files.
pub(crate) const BLOCK_ROWS: u32 = 16;

/// Bytes of a sequence that are in memory at a time: enough blocks for many threads, and
/// little compared with a whole rendering.
pub(crate) const STRIP_BYTES: usize = 128 << 20;

/// The most bytes that one byte of a Deflate stream can stand for, as two bits stand for at
/// most 258 bytes (RFC 1951). A lossless block of an EXR file is at least this fraction of
/// the size of its pixels.
pub(crate) const MOST_DEFLATED: u64 = 1032;

/// A number of rows, a multiple of [`BLOCK_ROWS`], that take up about [`STRIP_BYTES`].
pub(crate) fn strip_rows(row_bytes: usize) -> u32 {
    let blocks = STRIP_BYTES / row_bytes.saturating_mul(BLOCK_ROWS as usize).max(1);
    // Pictures have fewer than 2^31 rows.
    BLOCK_ROWS * (blocks.clamp(1, 1 << 20) as u32)
}
