//! Statements, and the materials that they make.

use glam::Vec2;

use super::*;

/// Materials of an MTL file, and what is told about them. `a b.png` is there.
fn load_with(text: &str, report: &mut Report) -> Result<Vec<Material>, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("x.mtl");
    std::fs::write(&path, text).expect("a file");
    let save = |name: &str, pixels: [[u8; 4]; 2]| {
        image::RgbaImage::from_fn(2, 1, |x, _| image::Rgba(pixels[x as usize]))
            .save(folder.path().join(name))
            .expect("an image");
    };
    save("a b.png", [[0, 0, 0, 255]; 2]);
    save("mask.png", [[255, 255, 255, 255], [0, 0, 0, 255]]);
    save("leaf.png", [[0, 128, 0, 0], [0, 128, 0, 255]]);
    save("normals.png", [[128, 128, 255, 255], [100, 150, 240, 255]]);
    std::fs::write(folder.path().join("damaged.png"), "no image").expect("a file");
    super::load(&path, &mut Images::default(), report).map_err(|error| error.to_string())
}

/// The only material, and the notes.
fn with_notes(statements: &str) -> (Material, Vec<String>) {
    let mut report = Report::default();
    let materials = load_with(&format!("newmtl m\n{statements}"), &mut report);
    let material = materials.expect("it is lenient").into_iter().next();
    (material.expect("one material"), report.notes())
}

/// The error of a strict reader.
fn error(text: &str) -> String {
    load_with(text, &mut Report::new(true)).expect_err(text)
}

fn material(statements: &str) -> Material {
    with_notes(statements).0
}

fn disney(statements: &str) -> Disney {
    match material(statements).scattering {
        Scattering::Disney(disney) => disney,
        other => panic!("{statements}: {other:?}"),
    }
}

#[test]
fn colours_and_emission() {
    let m = material("kd .1 .2 .3\nKe 4\nKa 9 9 9\nmap_Bump gone.png");
    assert_eq!(m.color, Vec3A::new(0.1, 0.2, 0.3));
    assert_eq!((m.emission, m.scattering), (Vec3A::splat(4.0), Scattering::Lambert));
    assert_eq!(material("").color, Vec3A::splat(GREY));
}

#[test]
fn textures_are_multiplied_by_what_is_not_black() {
    let names = ["a b.png", "-s 1 1 1 a b.png", "-o .5 -clamp on a b.png", "C:\\x\\a b.png"];
    for name in names {
        let m = material(&format!("Kd 0 0 0\nmap_Kd {name}"));
        assert!(m.color_texture.is_some());
        assert_eq!(m.color, Vec3A::ONE);
    }
    assert_eq!(material("map_Kd a b.png\nKd .5").color, Vec3A::splat(0.5));
    let m = material("map_Ke a b.png");
    assert!(m.emits() && m.emission_texture.is_some());
    assert_eq!(m.color, Vec3A::splat(GREY));
}

#[test]
fn physical_keys_make_a_disney_material() {
    let all = disney("Pr .1\nPm .2\nPs .3\nPc .4\nPcr .75\naniso .6\nNs 9\nKs 1\nillum 2");
    let expected = Disney {
        roughness: 0.1,
        metallic: 0.2,
        sheen: 0.3,
        clearcoat: 0.4,
        clearcoat_gloss: 0.25,
        anisotropic: 0.6,
        ..Default::default()
    };
    assert_eq!(all, expected);
    assert_eq!(disney("Pm 1"), Disney { metallic: 1.0, ..Default::default() });
}

#[test]
fn highlights_make_a_disney_material() {
    let plastic = disney("Kd .5\nKs .2 .4 .3\nNs 30\nillum 2");
    assert_eq!((plastic.specular, plastic.roughness, plastic.metallic), (0.4, 0.5, 0.0));
    let metal = material("Kd 0 0 0\nKs .9 .8 .1\nNs 30\nillum 3");
    assert_eq!(metal.color, Vec3A::new(0.9, 0.8, 0.1));
    assert!(matches!(metal.scattering, Scattering::Disney(Disney { metallic: 1.0, .. })));
    for matte in ["Ks 1\nillum 2", "Ks 1\nNs 9", "Ks 0\nNs 9\nillum 2", "Ks 1\nNs 0\nillum 2"] {
        assert_eq!(material(matte).scattering, Scattering::Lambert, "{matte}");
    }
}

/// The index of refraction, if it is glass.
fn ior(statements: &str) -> Option<f32> {
    match material(statements).scattering {
        Scattering::Dielectric { ior } => Some(ior),
        _ => None,
    }
}

#[test]
fn only_transparent_materials_that_refract_are_glass() {
    for illum in [4, 6, 7, 9] {
        let with = |rest: &str| ior(&format!("illum {illum}\nKd 0 0 0\n{rest}"));
        assert_eq!(with("d 0\nNi 1.33"), Some(1.33));
        assert_eq!(with("Tr .5\nNi 1.33"), Some(1.33));
        assert_eq!(with("Tf 0 1 0\nNi 1.33"), Some(1.33));
        // What Maya, Blender and others write for all materials.
        for opaque in [
            "",
            "Ni 1.5",
            "Ni 1.5\nd 1",
            "Tf 1 1 1\nNi 1",
            "Ni 1.5\nTf 0",
            "d .5",
            "d .5\nNi 1",
            "d 0\nNi 0",
        ] {
            assert_eq!(with(opaque), None, "{illum}, {opaque}");
        }
    }
    for illum in [0, 1, 2, 3, 5, 8, 10] {
        assert_eq!(ior(&format!("illum {illum}\nd .5\nNi 1.5")), None, "{illum}");
    }
    let glass = material("illum 4\nKd 0 0 0\nPr .5\nmap_Kd a b.png\nd .5\nNi 20");
    assert_eq!(glass.scattering, Scattering::Dielectric { ior: 10.0 });
    assert_eq!((glass.color, glass.color_texture, glass.opacity), (Vec3A::ONE, None, 1.0));
    assert!(error("newmtl m\nillum 4\nd .5\nNi 20").contains("line 4: material 'm': Ni 20 of a"));
}

/// Which of 0 and 1 is opaque, exporters disagree about.
#[test]
fn opacity_is_what_the_file_means() {
    for (statements, opacity, notes) in [
        ("", 1.0, 0),
        ("d .25", 0.25, 0),
        ("d -halo .25", 0.25, 1),
        ("d .25\nNi 1.5", 0.25, 0),
        ("d .25\nTr .25", 0.25, 0),
        ("Tr .25", 0.75, 0),
        ("d 1\nTr 1", 1.0, 0),
        ("d 0\nTr 0", 1.0, 1),
        ("d 0\nTr 1", 0.0, 0),
        ("d 0", 0.0, 0),
        ("d 0\nillum 2", 0.0, 0),
        ("d 0\nmap_Kd a b.png", 1.0, 1),
        ("Tr 1", 1.0, 1),
        ("Tr 1\nillum 2", 1.0, 1),
        ("Tr 1\nillum 4", 0.0, 0),
        ("Tr 1\nillum 4\nmap_Kd a b.png", 1.0, 1),
        ("illum 4\nNi 1\nTf 1 1 1", 1.0, 0),
    ] {
        let (material, told) = with_notes(&format!("Kd .5\n{statements}"));
        assert_eq!(material.opacity, opacity, "{statements}");
        assert_eq!(material.scattering, Scattering::Lambert, "{statements}");
        assert_eq!(told.len(), notes, "{statements}: {told:?}");
    }
}

#[test]
fn opacity_textures() {
    let texels = |statements: &str| {
        let texture = material(statements).opacity_texture?;
        Some(texture.image.texels().iter().map(|texel| texel[0]).collect::<Vec<_>>())
    };
    assert_eq!(texels("map_d mask.png"), Some(vec![1.0, 0.0]));
    assert_eq!(texels("map_d -mm 1 -1 mask.png"), Some(vec![0.0, 1.0]));
    assert_eq!(texels("map_d leaf.png"), Some(vec![0.0, 1.0]), "its alpha channel");
    assert_eq!(texels("map_d -imfchan r leaf.png"), Some(vec![0.0; 2]));
    assert_eq!(texels("map_Kd leaf.png\nmap_d leaf.png"), Some(vec![0.0, 1.0]));
    assert_eq!(texels("map_Kd leaf.png"), None, "alpha of a colour alone");
    assert_eq!(texels("map_Kd mask.png\nmap_d mask.png"), None, "the colour, without alpha");
    assert_eq!(texels("map_d -mm 1 0 mask.png"), None, "opaque everywhere");
    let half = material("d .5\nmap_d mask.png");
    assert_eq!((half.opacity, half.opacity_texture.is_some()), (0.5, true));
    assert_eq!(material("d 0\nmap_d mask.png").opacity, 1.0);
    assert_eq!(with_notes("map_Tr mask.png").1, ["map_Tr left out"]);
}

#[test]
fn options_say_how_textures_lie() {
    let m = material("map_Kd -s .25 2 1 -o .5 .125 0 -clamp on a b.png\nmap_Ke a b.png");
    let map = m.color_texture.expect("a texture");
    let lie = (map.scale, map.offset, map.clamp);
    assert_eq!(lie, (Vec2::new(0.25, 2.0), Vec2::new(0.5, 0.125), true));
    assert_eq!(m.emission_texture.expect("a texture"), TextureMap::from(map.image));
    let grey = material("map_Kd -mm .25 .5 -colorspace sRGB mask.png").color_texture;
    assert_eq!(grey.expect("a texture").image.texels(), [[0.75; 3], [0.25; 3]]);
    let (m, notes) = with_notes("map_Kd -new 1 2 -t 1 a b.png\nmap_Ke -new x a b.png");
    assert!(m.color_texture.is_some() && m.emission_texture.is_some());
    assert_eq!(notes.len(), 2, "{notes:?}");
    assert!(notes[0].contains(
        "left out: 2 (the first: x.mtl, line 2: material 'm': map_Kd: there is no option -new)"
    ));
    assert_eq!(notes[1], "option -t of map_Kd left out");
}

#[test]
fn reliefs() {
    let bumps = |statements: &str| match material(statements).relief {
        Some(Relief::Bumps { map, scale }) => (map.image.texels()[0][0], map.scale.x, scale),
        other => panic!("{statements}: {other:?}"),
    };
    for key in ["bump", "map_bump", "map_Bump"] {
        assert_eq!(bumps(&format!("{key} -s 3 -bm .25 -mm 0 2 mask.png")), (2.0, 3.0, 0.25));
    }
    let (m, notes) = with_notes("map_Bump normals.png");
    assert!(matches!(m.relief, Some(Relief::Normals(_))));
    assert_eq!(notes, ["bump maps that contain normals, used as normal maps"]);
    let (_, notes) = with_notes("norm -bm 2 normals.png");
    assert_eq!(notes, ["option -bm of normal maps left out"]);
    let (m, notes) = with_notes("norm normals.png\nbump mask.png\nmap_Ns a b.png\ndisp a b.png");
    let Some(Relief::Normals(map)) = m.relief else { panic!("{:?}", m.relief) };
    let expected = [128.0 / 255.0, 128.0 / 255.0, 1.0];
    assert_eq!(map.image.texels()[0], expected, "not decoded");
    assert_eq!(notes, ["map_Ns left out", "disp left out"]);
}

#[test]
fn faults_are_forgiven() {
    let plain = Material { name: "m".to_owned(), ..Material::default() };
    let color = |r, g, b| Material { color: Vec3A::new(r, g, b), ..plain.clone() };
    let emission = |e| Material { emission: Vec3A::splat(e), ..plain.clone() };
    for (statements, expected) in [
        ("Kd 1.0001 1 1", color(1.0, 1.0, 1.0)),
        ("Kd 255 128 0", color(1.0, 1.0, 0.0)),
        ("Kd -.1 .5 .5", color(0.0, 0.5, 0.5)),
        ("Kd .25 .5", color(0.25, 0.5, 0.5)),
        ("Kd", plain.clone()),
        ("Kd red", plain.clone()),
        ("Kd 1 0 0\nKd red", color(1.0, 0.0, 0.0)),
        ("Kd 1 0 0\nKd spectral x.rfl 1", color(1.0, 0.0, 0.0)),
        ("Kd nan .5 .5", plain.clone()),
        ("Kd spectral x.rfl 1", plain.clone()),
        ("Kd xyz .1 .2 .3", plain.clone()),
        ("Ke -1 0 0", emission(0.0)),
        ("Ke 1e39", emission(1e15)),
        ("d 1.5", plain.clone()),
        ("d nan", plain.clone()),
        ("Tr -1", plain.clone()),
        ("Ns", plain.clone()),
        ("Ns -5", plain.clone()),
        ("illum 11", plain.clone()),
        ("illum", plain.clone()),
        ("map_Kd", plain.clone()),
        ("map_Kd -s 1 1 1", plain.clone()),
        ("Kd .5\nmap_Kd gone.png", color(0.5, 0.5, 0.5)),
        ("Kd .5\nmap_Kd damaged.png", color(0.5, 0.5, 0.5)),
        ("Kd 0 0 0\nmap_Kd gone.png", plain.clone()),
        ("map_Ke gone.png", plain.clone()),
        ("map_d gone.png", plain.clone()),
        ("bump damaged.png", plain.clone()),
        ("norm gone.png", plain.clone()),
    ] {
        let (material, notes) = with_notes(statements);
        assert_eq!(material, expected, "{statements}");
        assert_eq!(notes.len(), 1, "{statements}: {notes:?}");
        assert!(notes[0].contains("x.mtl, line "), "{notes:?}");
        error(&format!("newmtl m\n{statements}"));
    }
    let mut report = Report::default();
    let text = "Kd 1 1 1\nNs 3\nnewmtl\nKd .5\nnewmtl a\nKd 2\nKs 3\n";
    let materials = load_with(text, &mut report).expect("it is lenient");
    let names: Vec<_> = materials.iter().map(|m| (&*m.name, m.color.x)).collect();
    assert_eq!(names, [("", 0.5), ("a", 1.0)]);
    let notes = report.notes();
    assert_eq!(notes.len(), 3, "{notes:?}");
    assert!(notes[0].starts_with("statements of no material, left out: 2 ("), "{notes:?}");
    assert!(notes[2].starts_with(OUT_OF_RANGE), "{notes:?}");
}

#[test]
fn errors_name_line_material_and_key() {
    let cases = [
        ("Kd 2 0 0", "Kd '2' is not within 0 and 1"),
        ("Kd 0 0", "Kd is of 2 numbers"),
        ("Kd", "Kd is of 0 numbers"),
        ("Kd red", "Kd 'red' is not a number"),
        ("Kd spectral x.rfl", "Kd 'spectral'"),
        ("Ke -1 0 0", "Ke '-1' is not within 0 and"),
        ("Ke 1e39", "Ke '1e39' is not finite"),
        ("Ns", "Ns without a number"),
        ("Ns -5", "Ns '-5'"),
        ("Pr 1.5", "Pr '1.5' is not within 0 and 1"),
        ("d nan", "d 'nan' is not finite"),
        ("illum 11", "illum '11'"),
        ("map_Kd", "map_Kd names no file"),
        ("map_Kd -s 1 1 1", "map_Kd names no file"),
        ("map_Kd gone.png", "gone.png"),
    ];
    for (statements, words) in cases {
        let error = error(&format!("# a file\nnewmtl m\n{statements}"));
        let complete = error.contains("x.mtl") && error.contains("line 3: material 'm': ");
        assert!(complete && error.contains(words), "{statements}: {error}");
    }
    assert!(error("Kd 1 1 1").contains("line 1: 'Kd' before"));
    assert!(error("newmtl").contains("line 1: newmtl without"));
}

/// Comments and missing words do not lose the file.
#[test]
fn images_are_found_behind_faults() {
    for statement in [
        "map_Kd a b.png # diffuse",
        "map_Kd -s 2 2 1 a b.png # twice",
        "map_Kd mask.png #1",
        "map_Kd -clamp mask.png",
        "map_Kd -colorspace mask.png",
    ] {
        let (material, notes) = with_notes(statement);
        assert!(material.color_texture.is_some(), "{statement}: {notes:?}");
        assert!(notes.len() == 1, "{statement}: {notes:?}");
        assert!(!material.color_texture.is_some_and(|map| map.clamp), "{statement}");
    }
}
