//! The primaries of colours: which red, green, blue and white their numbers mean.

use std::path::Path;

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
}
