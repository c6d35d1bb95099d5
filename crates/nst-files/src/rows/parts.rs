//! What files consist of: channels and attributes.

use std::collections::BTreeMap;

use exr::meta::attribute::SampleType;

/// Bytes of a sample: the channels of these files are f32 or u32.
pub(super) const SAMPLE: usize = 4;

/// The value of an attribute, of the types that our files use.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Attribute {
    Text(String),
    I32(i32),
    F32(f32),
}

/// Attributes by name.
pub(crate) type Attributes = BTreeMap<String, Attribute>;

/// A channel's name and type, f32 or u32.
pub(crate) type Channel = (String, SampleType);
