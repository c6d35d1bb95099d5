//! The table of results of `nst bench scene`: its rows, how it is read, and what it says.
//!
//! A [`Row`] is one method on one run at one sample count. [`Results`] are the rows of one
//! scene. [`Summary`] is what the runs of a method at one sample count have in common;
//! [`Curves`] are the errors of all methods against the time, with the Pareto front and
//! comparisons at equal time; [`advice()`] says it in a sentence.
//!
//! A new method needs nothing here. A new column is a line in [`Row`]; the reader then asks
//! for it.

mod advice;
mod curves;
mod metric;
mod pictures;
mod read;
mod row;
mod scene;
mod statistics;
mod summary;
pub(crate) mod text;

pub(crate) use advice::{advice, budgets};
pub(crate) use curves::{Curve, Curves, Point};
pub(crate) use metric::Metric;
#[cfg(feature = "render")]
pub(crate) use pictures::layer_of;
pub(crate) use pictures::{belongs, beside, check_name, method_of};
#[cfg(feature = "render")]
pub(crate) use read::parse_table;
#[cfg(any(feature = "render", test))]
pub(crate) use row::Row;
pub(crate) use row::{PLAIN, SCHEMA};
pub(crate) use scene::Results;
pub(crate) use summary::Summary;
