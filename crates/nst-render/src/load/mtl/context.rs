//! What the modules about materials have in common.

use std::path::Path;

use crate::load::{image::Images, report::Report};

/// What is done about a number beyond its range.
pub(super) const OUT_OF_RANGE: &str = "numbers of materials beyond their range, set to its end";
/// What is done about a statement that says nothing.
pub(super) const UNREADABLE: &str = "statements of materials that make no sense, left out";

/// What materials are made of: their file, and where its images and notes go.
pub(super) struct Context<'a> {
    pub(super) path: &'a Path,
    pub(super) images: &'a mut Images,
    pub(super) report: &'a mut Report,
}
