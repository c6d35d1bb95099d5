//! Faults of OBJ files whose meaning is plain all the same: each is forgiven with a note,
//! and refused where loading is strict.

use super::*;

const QUAD: &str =
    "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n";
const MTL: &str = "newmtl a\nKd .25 .5 .75\n";

/// Without the studio, whose lamps would be triangles, too.
fn options(strict: bool) -> LoadOptions {
    LoadOptions { strict, lighting: Some(Lighting::None), ..Default::default() }
}

/// The scene `x.obj` of a folder, whose only notes are of faults; and the error when it is
/// read strictly.
fn forgiven(folder: &TempDir) -> (Scene, String) {
    let path = folder.path().join("x.obj");
    let scene = Scene::load_with(&path, &options(false)).expect("it is forgiven");
    let strict = Scene::load_with(&path, &options(true));
    (scene, strict.expect_err("it is a fault").to_string())
}

fn path(folder: &TempDir) -> String {
    folder.path().join("x.obj").display().to_string()
}

/// Of an OBJ file without materials: the notes about faults alone.
fn notes(scene: &Scene) -> Vec<&str> {
    let usual = ["a grey material", "no camera is given", "nothing emits light"];
    let is_usual = |note: &str| usual.iter().any(|usual| note.starts_with(usual));
    scene.notes.iter().map(String::as_str).filter(|note| !is_usual(note)).collect()
}

/// Statements behind those of a quad; the note; the strict error; and what the triangles
/// have of normals and of texture coordinates.
#[test]
fn faults_become_one_note_of_each_kind() {
    let missing_normals = "corners whose normal is not there, where the surface is flat";
    let missing_uvs = "corners whose texture coordinate is not there, read as without one";
    let bad_normals = "normals that are not three finite numbers, where the surface is flat";
    let bad_uvs = "texture coordinates that are not finite numbers, read as missing";
    let behind = "words that are no numbers behind vertices and faces, left out";
    let upper = "keywords in upper case, read as those in lower case";
    let unknown = "statements with unknown keywords, left out";
    let cases = [
        ("f 1//1 2//2 3//9 4//1", format!("{missing_normals}: 2 (the first: x.obj, line 10: a face names normal 2, but there are only 1)"), [false; 2]),
        ("f 1/1/0 2/2/1 3/3/1", format!("{missing_normals} (x.obj, line 10: a face names normal 0; they count from 1)"), [false, true]),
        ("f 1//-2 2//1 3//1", format!("{missing_normals} (x.obj, line 10: a face names normal -2, but there are only 1 before it)"), [false; 2]),
        ("f 1//99999999999 2//1 3//1", format!("{missing_normals} (x.obj, line 10: a face names normal 4294967295, but"), [false; 2]),
        ("f 1/1/1 2/0/1 3/-9/1", format!("{missing_uvs}: 2 (the first: x.obj, line 10: a face names texture coordinate 0"), [true, false]),
        ("f 1/5 2/6 3/7", format!("{missing_uvs}: 3 (the first: x.obj, line 10: a face names texture coordinate 5, but there are only 4)"), [false; 2]),
        ("vn nan nan nan\nf 1//2 2//2 3//2", format!("{bad_normals} (x.obj, line 10: normal 2 is not finite)"), [false; 2]),
        ("vn -1.#IND 0 1e99\nvn inf 0 0\nf 1/1/2 2/2/3 3/3/1", format!("{bad_normals}: 2 (the first: x.obj, line 10: normal 2 is not finite)"), [false, true]),
        ("vn 0 0\nvn 0 zero 0\nf 1 2 3", format!("{bad_normals}: 2 (the first: x.obj, line 10: normal 2 is not finite)"), [false; 2]),
        ("vt nan 0\nvt 0 -inf\nvt\nf 1/5/1 2/2/1 3/3/1", format!("{bad_uvs}: 3 (the first: x.obj, line 10: texture coordinate 5 is not finite)"), [true, false]),
        ("f 1 2 3 and 4", format!("{behind} (x.obj, line 10: 'and' behind a face is no corner)"), [false; 2]),
        ("v 0 0 0 red\nf 1 2 3", format!("{behind} (x.obj, line 10: 'red' behind a vertex is no number)"), [false; 2]),
        ("VN 0 0 1\nF 1//2 2//2 3//2", format!("{upper}: 2 (the first: x.obj, line 10: keyword 'VN' is in upper case)"), [true, false]),
        ("fo 1/1 2/2 3/3", "the obsolete 'fo', read as 'f' (x.obj, line 10: 'fo' is obsolete)".to_owned(), [false, true]),
        ("f 1 2 3\nfoo 1\nbar", format!("{unknown}: 2 (the first: x.obj, line 11: keyword 'foo' is unknown)"), [false; 2]),
        ("f 1 2 3\ncall x.obj\ncsh -rm x", "calls of other files and programs, left out: 2 (the first: x.obj, line 11: 'call' is not obeyed)".to_owned(), [false; 2]),
        ("usemtl\nf 1 2 3", "usemtl without a name: the default material (x.obj, line 10: usemtl without a name)".to_owned(), [false; 2]),
        ("mtllib \nf 1 2 3", "mtllib without a name, left out (x.obj, line 10: mtllib without a name)".to_owned(), [false; 2]),
        ("f 1 2 3\n\0\0\0", "what is behind the end of the text, left out (x.obj, line 11: 3 bytes".to_owned(), [false; 2]),
    ];
    for (statements, note, [has_normals, has_uvs]) in cases {
        let folder = folder(&[("x.obj", &format!("{QUAD}{statements}"))]);
        let (scene, error) = forgiven(&folder);
        let notes = notes(&scene);
        assert!(notes.len() == 1 && notes[0].starts_with(&note), "{statements}: {notes:?}");
        // The error is the first fault.
        let (_, fault) = note.rsplit_once("x.obj, ").expect("a place");
        let expected = format!("scene '{}': {}", path(&folder), fault.trim_end_matches(')'));
        assert!(error.starts_with(&expected), "{statements}: {error}");
        for triangle in &scene.triangles {
            assert_eq!(triangle.normals.is_some(), has_normals, "{statements}");
            assert_eq!(triangle.uvs.is_some(), has_uvs, "{statements}");
            assert_eq!(triangle.area_vector(), Vec3A::Z * 4.0, "{statements}");
        }
    }
}

/// Many faults are still one note, and no other.
#[test]
fn floods_of_faults_are_one_note() {
    let scene = scene(&format!("{QUAD}{}", "f 1//7 2//7 3//7\n".repeat(2000)));
    assert_eq!(scene.triangles.len(), 2000);
    assert!(notes(&scene).len() == 1 && notes(&scene)[0].contains(": 6000 (the first"));
}

/// What is no fault is not noted, and read alike when loading is strict.
#[test]
fn what_is_no_fault() {
    let statements = [
        "f 1/ 2// 3/3/",
        "f 1/1/1 2/2/1 3/3/1 # a comment",
        "f 1 2 3#4",
        "f -4/-4/-1 -3/-3/-1 -2/-2/-1",
        "f +1 +2 +3",
        "g a b\no c\ns off\nmg 0\nusemap x\nlod 3\nf 1 2 3\nvp 1 2 3\ncstype bezier\nend",
        "v nan 1e99 inf\nf 1 2 3",
        "v 0 0 0 0\nf 1 2 3",
        "f 1\u{a0}2\u{3000}3",
        "f 1 2 \\\n3",
    ];
    for statements in statements {
        let folder = folder(&[("x.obj", &format!("{QUAD}{statements}\n"))]);
        let scene =
            Scene::load_with(&folder.path().join("x.obj"), &options(true)).expect(statements);
        assert_eq!(notes(&scene), [""; 0], "{statements}");
        assert_eq!(scene.triangles[0].area_vector(), Vec3A::Z * 4.0, "{statements}");
    }
}

#[test]
fn errors_name_the_line() {
    let long = "9x".repeat(100_000);
    let cases = [
        ("f 1 2 9", "line 10: a face names vertex 9, but there are only 4"),
        ("f 1 2 -5", "line 10: a face names vertex -5, but there are only 4 before it"),
        ("f 1 2 0", "line 10: a face names vertex 0; they count from 1"),
        ("f 1 2 9223372036854775807", "line 10: a face names vertex 9223372036854775807, but"),
        ("f 1 2 -9223372036854775808", "line 10: a face names vertex -92"),
        ("f 1 2 99999999999999999999", "line 10: face corner '99999999999999999999' is not"),
        ("f 1 2 3/1/1/1", "line 10: face corner '3/1/1/1' has more"),
        ("f 1 2 c", "line 10: face corner 'c'"),
        ("f 1 2 /3", "line 10: face corner '/3'"),
        ("\n\nv 0 zero 0", "line 12: vertex 'zero' is not a number"),
        ("v 0 1,5 0", "line 10: vertex '1,5' is not a number; decimals need a point"),
        ("v 0 0", "line 10: vertex of 2 numbers instead of 3"),
        (
            "f 1 2 5\nv 0 0 1e39",
            "line 11: vertex 5 is not finite: beyond 3.4e38, and the face of line 10 needs it",
        ),
        ("v 0 0 nan\nf 1 2 3\nf 1 2 5", "line 10: vertex 5 is not finite, and the face of line 12"),
        ("v 0 0 1 0\nf 1 2 5", "line 10: vertex 5 divided by its weight is not finite"),
        ("v 0 1e30 1 1e-30\nf 1 2 5", "line 10: vertex 5 divided by its weight"),
        (&format!("v 0 0 {long}"), "line 10: vertex '9x9x"),
        (&format!("f 1 2 {long}"), "line 10: face corner '9x9x"),
    ];
    for (statements, words) in cases {
        let error = load(&[("x.obj", &format!("{QUAD}{statements}\n"))]).expect_err(words);
        assert!(error.contains(words) && error.len() < 300, "{words}: {error}");
    }
}

#[test]
fn files_of_other_formats_are_told_apart() {
    for (content, words) in [
        ("solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n", ["no faces", "an STL model"]),
        ("ply\nformat ascii 1.0\n", ["a PLY model", "Blender"]),
        ("LookAt 0 0 5  0 0 0  0 1 0\nCamera \"perspective\"\n", ["no faces", "a pbrt scene"]),
        ("<?xml version='1.0'?>\n<scene version='3.0.0'>\n", ["no faces", "a Mitsuba scene"]),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\n", ["no faces", "3 vertices, as a point cloud"]),
        ("v 0 0 0\nv 1 nan 0\n", ["line 2", "vertex 2 is not finite, and there are no faces"]),
    ] {
        let error = load(&[("x.obj", content)]).expect_err(content);
        assert!(words.iter().all(|words| error.contains(words)), "{content}: {error}");
    }
}

/// Statements in front of the quad's face; both files, and whether there is a fault.
#[test]
fn materials_are_found_behind_comments_and_quotes() {
    let cases = [
        ("mtllib x.mtl", "usemtl a", MTL, false),
        ("mtllib x.mtl # the library", "usemtl a", MTL, true),
        ("MTLLIB x.mtl", "USEMTL a", MTL, true),
        ("mtllib \"x.mtl\"", "usemtl \"a\"", MTL, false),
        ("mtllib x.mtl", "usemtl a # front", MTL, true),
        ("mtllib x.mtl", "usemtl a", "newmtl a # front\nKd .25 .5 .75\n", false),
        ("mtllib x.mtl", "usemtl a\t#1", "newmtl a # front\nKd .25 .5 .75\n", true),
        (
            "mtllib x.mtl",
            "usemtl a #2",
            "newmtl a #1\nKd 1\nnewmtl a #2\nKd .25 .5 .75\nnewmtl a #3\nKd 1\n",
            false,
        ),
        ("mtllib x.mtl", "usemtl a", "newmtl \"a\"\nKd .25 .5 .75\n", false),
        ("mtllib gone.mtl x.mtl", "usemtl a", MTL, true),
        ("mtllib y z.mtl x.mtl", "usemtl a", MTL, false),
        ("mtllib C:\\me\\X.MTL", "usemtl a", MTL, false),
    ];
    for (library, usage, mtl, is_fault) in cases {
        let obj = format!("{library}\n{QUAD}{usage}\nf 1 2 3 4\n");
        let files = [("x.obj", obj.as_str()), ("x.mtl", mtl), ("y z.mtl", "newmtl b\n")];
        let folder = folder(&files);
        let scene = Scene::load(&folder.path().join("x.obj")).expect(library);
        let color = scene.materials[scene.triangles[0].material as usize].color;
        assert_eq!(color, Vec3A::new(0.25, 0.5, 0.75), "{library}, {usage}");
        if is_fault {
            forgiven(&folder);
        }
    }
    // The sidecar names materials without their comments.
    let mtl = "newmtl a # front\nKd .25 .5 .75\n";
    let obj = format!("mtllib x.mtl\n{QUAD}usemtl a # back\nf 1 2 3 4\n");
    let toml = "[materials.a]\ncolor = [1, 0, 0]\n";
    let scene = load(&[("x.obj", &obj), ("x.mtl", mtl), ("x.toml", toml)]).expect("a good scene");
    assert_eq!(scene.materials[0].color, Vec3A::X);
}

#[test]
fn missing_libraries_leave_faces_grey() {
    let obj = format!("mtllib nope.mtl\n{QUAD}usemtl a\nf 1 2 3 4\n");
    let (scene, error) = forgiven(&folder(&[("x.obj", &obj)]));
    assert!(error.contains("line 1: mtllib: cannot read") && error.contains("nope.mtl"), "{error}");
    assert_eq!(scene.materials[0].color, Vec3A::splat(0.8));
    let all = scene.notes.join("; ");
    assert!(all.contains("MTL files that are not there, left out (x.obj, line 1: mtllib"), "{all}");
    assert!(all.contains("or one that no MTL file has ('a')"), "{all}");
}

/// The default material for the faces behind a `usemtl` without a name, as Blender writes it.
#[test]
fn usemtl_without_a_name_ends_the_material() {
    let obj = format!("mtllib x.mtl\n{QUAD}usemtl a\nf 1 2 3\nusemtl \nf 1 3 4\n");
    let (scene, _) = forgiven(&folder(&[("x.obj", &obj), ("x.mtl", MTL)]));
    let colors: Vec<_> =
        scene.triangles.iter().map(|t| scene.materials[t.material as usize].color).collect();
    assert_eq!(colors, [Vec3A::new(0.25, 0.5, 0.75), Vec3A::splat(0.8)]);
    // A comment is no name.
    let obj = format!("mtllib x.mtl\n{QUAD}usemtl # none\nf 1 2 3 4\n");
    let (scene, _) = forgiven(&folder(&[("x.obj", &obj), ("x.mtl", "newmtl a\nKd .1\n")]));
    assert_eq!(scene.materials[1].color, Vec3A::splat(0.8));
    let notes = scene.notes.join("; ");
    assert!(notes.contains("where the file names none;"), "{notes}");
}

/// Names in Shift-JIS, GBK and Big5 whose last byte is that of a backslash.
#[test]
fn names_of_two_bytes_continue_no_line() {
    for name in [&b"\x95\\"[..], b"\xbf\\", b"\xa5\x5c\xb8\x5c"] {
        let folder = folder(&[]);
        let path = |name: &str| folder.path().join(name);
        let obj = [b"mtllib x.mtl\n", QUAD.as_bytes(), b"usemtl ", name, b"\nf 1 2 3 \\\n4\n"];
        std::fs::write(path("x.obj"), obj.concat()).expect("a file");
        let mtl = [b"newmtl ", name, b"\nKd .25 .5 .75\n"];
        std::fs::write(path("x.mtl"), mtl.concat()).expect("a file");
        let scene = Scene::load_with(&path("x.obj"), &options(false)).expect("a good scene");
        assert_eq!(scene.triangles.len(), 2);
        assert_eq!(scene.materials[0].color, Vec3A::new(0.25, 0.5, 0.75));
    }
}

#[test]
fn utf16_is_read() {
    let units = format!("\u{feff}{QUAD}f 1 2 3 4\n");
    let bytes: Vec<u8> = units.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let folder = folder(&[]);
    let path = folder.path().join("x.obj");
    std::fs::write(&path, bytes).expect("a file");
    let scene = Scene::load_with(&path, &options(false)).expect("a good scene");
    assert_eq!(scene.triangles.len(), 2);
    assert!(scene.notes[0].ends_with("is UTF-16"), "{:?}", scene.notes);
}
