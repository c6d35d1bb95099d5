//! Vector instructions of x86 processors.

mod floats;
mod tokens;
mod vectors;

pub(crate) use tokens::{Avx2, Avx512};
