//! What is called of the library, and what happens where it fails: with a library in C that
//! logs each call. `tests/peers` runs the real one.
//!
//! Only where `cc` is the C compiler's name.
#![cfg(unix)]

mod calls;
mod failures;
mod fake;
mod loading;
