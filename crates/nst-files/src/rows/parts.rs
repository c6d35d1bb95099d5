//! What files consist of: channels and attributes.

use std::collections::BTreeMap;

use exr::meta::attribute::{SampleType, Text};

/// Bytes of a sample: the channels of these files are f32 or u32.
pub(super) const SAMPLE: usize = 4;

/// The value of an attribute, of the types that our files use.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Attribute {
    Text(String),
    I32(i32),
    F32(f32),
}

/// The value of a text attribute: EXR's are UTF-8, but some files have Latin-1.
pub(crate) fn text(value: &Text) -> String {
    String::from_utf8(value.as_slice().to_vec()).unwrap_or_else(|_| value.to_string())
}

/// Attributes by name.
pub(crate) type Attributes = BTreeMap<String, Attribute>;

/// A channel's name and type, f32 or u32.
pub(crate) type Channel = (String, SampleType);
