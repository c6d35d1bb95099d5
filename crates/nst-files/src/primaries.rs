//! The primaries of colours: which red, green, blue and white their numbers mean.

use std::{collections::BTreeMap, path::Path};

/// Chromaticities in CIE xy, from ITU-R BT.709 and BT.2020, SMPTE EG 432-1 (P3), and the
/// Academy's S-2014-004 and TB-2014-004.
const PRIMARIES: [(&str, [[f32; 2]; 4]); 5] = {
    const D65: [f32; 2] = [0.3127, 0.3290];
    const ACES: [f32; 2] = [0.32168, 0.33767];
    [
        ("sRGB", [[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], D65]),
        ("Rec. 2020", [[0.708, 0.292], [0.170, 0.797], [0.131, 0.046], D65]),
        ("Display P3", [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060], D65]),
        ("ACEScg (AP1)", [[0.713, 0.293], [0.165, 0.830], [0.128, 0.044], ACES]),
        ("ACES (AP0)", [[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.0770], ACES]),
    ]
};

/// What to tell about a file whose primaries are not those of sRGB: nothing here converts
/// them.
pub(crate) fn note(path: &Path, primaries: [[f32; 2]; 4]) -> Option<String> {
    let is_near = |other: &[[f32; 2]; 4]| {
        primaries.iter().flatten().zip(other.iter().flatten()).all(|(a, b)| (a - b).abs() < 2e-3)
    };
    let (name, known) = PRIMARIES[0];
    if is_near(&known) {
        return None;
    }
    let found = PRIMARIES.iter().find(|(_, known)| is_near(known));
    let whose = found.map_or("others", |(name, _)| name);
    let path = path.display();
    Some(format!("'{path}' has not the primaries of {name}, but {whose}: taken as they are"))
}

/// The colour space that a part of a file names, where it is another one than linear sRGB.
/// Linear Rec. 709 has the primaries of sRGB.
pub(crate) fn foreign_space(attributes: &BTreeMap<String, String>) -> Option<String> {
    let space = attributes.get("colorInteropID")?;
    let known = ["lin_rec709_scene", "data", "unknown"].contains(&space.as_str());
    (!known).then(|| space.clone())
}

/// What to tell about a file of another colour space.
pub(crate) fn space_note(path: &Path, space: &str) -> String {
    let path = path.display();
    format!("'{path}' has not the colours of linear sRGB, but of {space}: taken as they are")
}

#[cfg(test)]
mod tests {
    use exr::prelude::*;

    use super::PRIMARIES;

    #[test]
    fn foreign_primaries_are_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.exr");
        let note = |chromaticities: Option<[[f32; 2]; 4]>| {
            let mut image =
                Image::from_channels((1, 1), SpecificChannels::rgb(|_| (0.0, 0.0, 0.0)));
            image.attributes.chromaticities = chromaticities.map(|c| {
                let [red, green, blue, white] = c.map(|[x, y]| Vec2(x, y));
                exr::meta::attribute::Chromaticities { red, green, blue, white }
            });
            image.write().to_file(&path).expect("a file");
            crate::picture::Picture::open(&path, None).expect("a picture").primaries_note()
        };
        assert_eq!(note(None), None);
        assert_eq!(note(Some(PRIMARIES[0].1)), None);
        for (name, primaries) in &PRIMARIES[1..] {
            let note = note(Some(*primaries)).expect("a note");
            assert!(note.contains(name) && note.contains("x.exr"), "{note}");
        }
        let mut odd = PRIMARIES[0].1;
        odd[1][0] = 0.25;
        assert!(note(Some(odd)).expect("a note").contains("others"));
    }

    #[test]
    fn foreign_spaces_are_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.exr");
        let picture = |space: Option<&str>| {
            let pixels = SpecificChannels::rgb(|_| (0.0, 0.0, 0.0));
            let mut image = Image::from_channels((1, 1), pixels);
            if let Some(space) = space {
                let attributes = &mut image.layer_data.attributes.other;
                attributes.insert("colorInteropID".into(), AttributeValue::Text(space.into()));
            }
            image.write().to_file(&path).expect("a file");
            crate::picture::Picture::open(&path, None).expect("a picture")
        };
        for usual in [None, Some("lin_rec709_scene"), Some("data"), Some("unknown")] {
            assert_eq!(picture(usual).primaries_note(), None);
            assert!(picture(usual).has_primaries_of(&picture(None)), "{usual:?}");
        }
        for other in ["lin_ap1_scene", "srgb_rec709_display"] {
            let note = picture(Some(other)).primaries_note().expect("a note");
            assert!(note.contains(other) && note.contains("x.exr"), "{note}");
            assert!(!picture(Some(other)).has_primaries_of(&picture(None)), "{other}");
        }
    }
}
