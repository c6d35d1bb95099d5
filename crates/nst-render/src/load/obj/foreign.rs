//! Files of other formats that are named as a scene: which they are, and what to do.

use std::path::Path;

const CONVERT: &str = "convert it to OBJ first, for example with Blender (import it, then \
     export Wavefront OBJ)";
const MITSUBA: &str = "name its OBJ meshes, or convert it to OBJ first";

/// What formats begin with that are no text, or whose text cannot be an OBJ file's.
const BEGINNINGS: [(&[u8], &str, &str); 22] = [
    (b"glTF", "a GLB model", CONVERT),
    (b"Kaydara FBX Binary", "an FBX model", CONVERT),
    (b"; FBX", "an FBX model", CONVERT),
    (b"BLENDER", "a Blender file", "open it in Blender, and export Wavefront OBJ"),
    (b"ply\n", "a PLY model", CONVERT),
    (b"ply\r", "a PLY model", CONVERT),
    (b"PXR-USDC", "a USD scene", CONVERT),
    (b"#usda", "a USD scene", CONVERT),
    (b"xof ", "a DirectX model", CONVERT),
    (b"#VRML", "a VRML model", CONVERT),
    (b"OFF\n", "an OFF model", CONVERT),
    (b"Ogawa", "an Alembic scene", CONVERT),
    (b"PK\x03\x04", "a ZIP archive", "unpack it, and name the OBJ file in it"),
    (b"\x1f\x8b", "a gzip archive", "unpack it first"),
    (
        b"\x28\xb5\x2f\xfd",
        "a zstd archive (Blender saves these)",
        "open it in Blender, and export Wavefront OBJ",
    ),
    (b"version https://git-lfs", "a pointer of Git LFS", "fetch the file itself: git lfs pull"),
    (b"<!DOCTYPE html", "a page of the web", "download the file itself"),
    (b"<html", "a page of the web", "download the file itself"),
    (b"\x89PNG", "a PNG image", IMAGE),
    (b"\xff\xd8\xff", "a JPEG image", IMAGE),
    (b"\x76\x2f\x31\x01", "an OpenEXR image", IMAGE),
    (b"\x7fELF", "a program", IMAGE),
];
const IMAGE: &str = "name an OBJ file";

/// What texts without faces contain, when they are none of OBJ.
const CONTENTS: [(&[&str], &str, &str); 9] = [
    (&["solid", "facet", "vertex"], "an STL model", CONVERT),
    (&["WorldBegin"], "a pbrt scene", MITSUBA),
    (&["LookAt", "Camera"], "a pbrt scene", MITSUBA),
    (&["<scene"], "a Mitsuba scene", MITSUBA),
    (&["<COLLADA"], "a COLLADA model", CONVERT),
    (&["<X3D"], "an X3D model", CONVERT),
    (&["{", "\"asset\""], "a glTF model", CONVERT),
    (&["newmtl"], "an MTL file", "name the OBJ file that refers to it"),
    (&["requires maya"], "a Maya scene", "export Wavefront OBJ from Maya"),
];

/// What the names of files say.
const EXTENSIONS: [(&str, &str, &str); 18] = [
    ("stl", "an STL model", CONVERT),
    ("ply", "a PLY model", CONVERT),
    ("off", "an OFF model", CONVERT),
    ("fbx", "an FBX model", CONVERT),
    ("glb", "a GLB model", CONVERT),
    ("gltf", "a glTF model", CONVERT),
    ("blend", "a Blender file", "open it in Blender, and export Wavefront OBJ"),
    ("3ds", "a 3DS model", CONVERT),
    ("dae", "a COLLADA model", CONVERT),
    ("usd", "a USD scene", CONVERT),
    ("abc", "an Alembic scene", CONVERT),
    ("max", "a 3ds Max scene", "export Wavefront OBJ from 3ds Max"),
    ("pbrt", "a pbrt scene", MITSUBA),
    ("xml", "an XML file, perhaps a Mitsuba scene", MITSUBA),
    ("mtl", "an MTL file", "name the OBJ file that refers to it"),
    ("toml", "a TOML file", "name the OBJ file beside it"),
    ("json", "a JSON file", "name an OBJ file"),
    ("exr", "an OpenEXR image", IMAGE),
];

/// Of a file's bytes: why it cannot be an OBJ file, if that is plain.
pub(super) fn refused(path: &Path, bytes: &[u8]) -> Option<String> {
    let beginning = BEGINNINGS.iter().find(|(beginning, ..)| bytes.starts_with(beginning));
    if let Some((_, what, advice)) = beginning {
        return Some(format!("this is {what}, no text of OBJ; {advice}"));
    }
    if is_binary_stl(bytes) {
        return Some(format!("this is an STL model, no text of OBJ; {CONVERT}"));
    }
    // Padding at the end is forgiven.
    let last = bytes.iter().rposition(|&byte| byte != 0)?;
    let is_text =
        bytes[0] >= 0xfe || bytes[..4.min(last)].contains(&0) || !bytes[..last].contains(&0);
    if is_text {
        return None;
    }
    by_extension(path).map(|(what, advice)| format!("this is {what}, no text of OBJ; {advice}"))
}

/// Of a text without faces: what it is, and what to do.
/// `others`: how many points, lines, curves and surfaces it has.
pub(super) fn without_faces(path: &Path, text: &str, vertices: usize, others: usize) -> String {
    const NONE: &str = "it has no faces; there is nothing to render";
    let contains = |words: &&(&[&str], &str, &str)| words.0.iter().all(|word| text.contains(word));
    let by_contents = || CONTENTS.iter().find(contains).map(|&(_, what, advice)| (what, advice));
    let known = if vertices > 0 || others > 0 {
        None
    } else {
        by_contents().or_else(|| by_extension(path))
    };
    match known {
        Some((what, advice)) => format!("{NONE}: this is {what}; {advice}"),
        None if others > 0 => format!(
            "{NONE}: it has points, lines, curves or surfaces alone; make faces of them first, \
             for example with Blender"
        ),
        None if vertices > 0 => format!(
            "{NONE}: it has {vertices} vertices, as a point cloud; make a surface of them first, \
             for example with MeshLab"
        ),
        None => NONE.to_owned(),
    }
}

fn by_extension(path: &Path) -> Option<(&'static str, &'static str)> {
    let extension = path.extension()?.to_str()?;
    let known = EXTENSIONS.iter().find(|(known, ..)| extension.eq_ignore_ascii_case(known));
    known.map(|&(_, what, advice)| (what, advice))
}

/// A header of 80 bytes, a number of triangles, and 50 bytes for each.
fn is_binary_stl(bytes: &[u8]) -> bool {
    let Some(&[a, b, c, d]) = bytes.get(80..84) else { return false };
    let triangles = u64::from(u32::from_le_bytes([a, b, c, d]));
    triangles > 0 && 84 + 50 * triangles == bytes.len() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_told_apart() {
        let mut stl = vec![b' '; 84 + 100];
        stl[80..84].copy_from_slice(&[2, 0, 0, 0]);
        let cases: [(&str, &[u8], &str); 8] = [
            ("x.obj", &stl, "an STL model"),
            ("x.glb", b"glTF\x02\0\0\0", "a GLB model"),
            ("x.obj", b"ply\nformat ascii 1.0\n", "a PLY model"),
            ("x.blend", b"BLENDER-v300", "a Blender file"),
            ("x.3ds", b"MM\x05\x01\x01\0\0\x01", "a 3DS model"),
            ("x.obj", b"\x89PNG\r\n\x1a\n", "a PNG image"),
            ("x.obj", b"version https://git-lfs.github.com/spec/v1\n", "a pointer of Git LFS"),
            ("x.obj", b"<!DOCTYPE html>\n<html>", "a page of the web"),
        ];
        for (name, bytes, what) in cases {
            let message = refused(Path::new(name), bytes).unwrap_or_default();
            assert!(message.contains(what) && message.contains("no text"), "{name}: {message}");
        }
        for bytes in [
            &b"v 1 2 3\n"[..],
            b"",
            b"\0\0\0\0",
            b"v 1 2 3\n\0\0\0",
            b"\xff\xfev\0 \0",
            b"v\0 \x001\0",
        ] {
            assert_eq!(refused(Path::new("x.stl"), bytes), None, "{bytes:?}");
        }
        let texts = [
            ("x.stl", "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n", 0, "an STL model"),
            ("x.obj", "WorldBegin\nShape \"sphere\"\n", 0, "a pbrt scene"),
            ("x.xml", "<scene version=\"3.0.0\">\n</scene>\n", 0, "a Mitsuba scene"),
            ("x.gltf", "{\"asset\": {\"version\": \"2.0\"}}", 0, "a glTF model"),
            ("x.obj", "newmtl a\nKd 1 1 1\n", 0, "an MTL file"),
            ("x.toml", "[film]\n", 0, "a TOML file"),
            ("x.obj", "v 1 2 3\nv 1 2 4\n", 2, "2 vertices, as a point cloud"),
            ("x.obj", "# nothing\n", 0, "nothing to render"),
        ];
        let lines = without_faces(Path::new("x.obj"), "v 1 2 3\nv 2 3 4\nl 1 2\n", 2, 1);
        assert!(lines.contains("lines, curves") && !lines.contains("point cloud"), "{lines}");
        for (name, text, vertices, what) in texts {
            let message = without_faces(Path::new(name), text, vertices, 0);
            assert!(
                message.starts_with("it has no faces") && message.contains(what),
                "{name}: {message}"
            );
        }
    }
}
