//! All that is not safe: the library's functions, and its objects, which are released when
//! they are dropped.
//!
//! The functions are declared as in `include/OpenImageDenoise/oidn.h` of version 2; those
//! that are used here are the same from 2.0 on.
#![allow(unsafe_code, reason = "functions of a library in C are called")]

mod functions;
mod objects;

pub(crate) use functions::{Functions, LoadError};
pub(crate) use objects::{Buffer, Device, Failure, Filter};
