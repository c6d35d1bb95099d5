use std::sync::Arc;

use glam::{Vec2, Vec3A};

use super::*;
use crate::{Camera, Environment, PixelFilter, Texture};

fn texture(last: f32) -> Option<Arc<Texture>> {
    Texture::new([2, 1], vec![[0.5, 0.25, 0.125], [1.0, 0.75, last]]).map(Arc::new)
}

fn material(scattering: Scattering) -> Material {
    Material {
        name: "m".into(),
        color: Vec3A::new(0.1, 0.2, 0.3),
        color_texture: None,
        emission: Vec3A::ZERO,
        emission_texture: None,
        scattering,
    }
}

/// Two triangles, one with normals and texture coordinates, and one material of each
/// kind: numbers that f32 has exactly, or that are parsed alike everywhere.
fn tiny() -> Scene {
    let bare = Triangle {
        positions: [Vec3A::ZERO, Vec3A::X, Vec3A::Y],
        normals: None,
        uvs: None,
        material: 0,
    };
    let full = Triangle {
        positions: [Vec3A::Z, Vec3A::X, Vec3A::Y * 2.0],
        normals: Some([Vec3A::Z; 3]),
        uvs: Some([Vec2::ZERO, Vec2::X, Vec2::Y]),
        material: 2,
    };
    let textured = Material {
        color_texture: texture(0.5),
        emission: Vec3A::new(1.0, 2.0, 4.0),
        emission_texture: texture(8.0),
        ..material(Scattering::Lambert)
    };
    let materials = vec![
        material(Scattering::Disney(Disney::default())),
        material(Scattering::Dielectric { ior: 1.5 }),
        textured,
    ];
    Scene {
        name: "tiny".into(),
        triangles: vec![bare, full],
        vertex_colors: vec![],
        materials,
        camera: Camera {
            position: Vec3A::new(0.0, 0.0, 5.0),
            target: Vec3A::ZERO,
            up: Vec3A::Y,
            vertical_fov: 40.0,
        },
        size: [4, 4],
        max_depth: 8,
        russian_roulette: true,
        pixel_filter: PixelFilter::Box,
        environment: Environment {
            radiance: Vec3A::ONE,
            image: texture(2.0),
            ..Default::default()
        },
        notes: vec![],
        inputs: vec![],
    }
}

fn disney(scene: &mut Scene) -> &mut Disney {
    match &mut scene.materials[0].scattering {
        Scattering::Disney(disney) => disney,
        other => panic!("{other:?}"),
    }
}

type Change = (&'static str, fn(&mut Scene));

/// Everything that decides a pixel's integral.
const CHANGES: [Change; 40] = [
    ("name", |s| s.name = "other".into()),
    ("position", |s| s.triangles[1].positions[2].z = 0.5),
    ("corners", |s| s.triangles[0].positions.swap(0, 1)),
    ("order of triangles", |s| s.triangles.swap(0, 1)),
    ("number of triangles", |s| s.triangles.truncate(1)),
    ("material of a triangle", |s| s.triangles[0].material = 1),
    ("normal", |s| s.triangles[1].normals = Some([Vec3A::Z, Vec3A::Z, Vec3A::Y])),
    ("no normals", |s| s.triangles[1].normals = None),
    ("uv", |s| s.triangles[1].uvs = Some([Vec2::ZERO, Vec2::X, Vec2::ONE])),
    ("no uvs", |s| s.triangles[1].uvs = None),
    ("number of materials", |s| s.materials.push(material(Scattering::Lambert))),
    ("order of materials", |s| s.materials.swap(0, 1)),
    ("color", |s| s.materials[0].color.z = 0.5),
    ("emission", |s| s.materials[0].emission.x = 0.5),
    ("color texture", |s| s.materials[2].color_texture = texture(0.75)),
    ("no color texture", |s| s.materials[2].color_texture = None),
    ("emission texture", |s| s.materials[2].emission_texture = texture(9.0)),
    ("no emission texture", |s| s.materials[2].emission_texture = None),
    ("kind", |s| s.materials[0].scattering = Scattering::Lambert),
    ("metallic", |s| disney(s).metallic = 0.25),
    ("roughness", |s| disney(s).roughness = 0.25),
    ("specular", |s| disney(s).specular = 0.25),
    ("specular tint", |s| disney(s).specular_tint = 0.25),
    ("anisotropic", |s| disney(s).anisotropic = 0.25),
    ("sheen", |s| disney(s).sheen = 0.25),
    ("sheen tint", |s| disney(s).sheen_tint = 0.25),
    ("clearcoat", |s| disney(s).clearcoat = 0.25),
    ("clearcoat gloss", |s| disney(s).clearcoat_gloss = 0.25),
    ("ior", |s| s.materials[1].scattering = Scattering::Dielectric { ior: 1.25 }),
    ("radiance", |s| s.environment.radiance.y = 0.5),
    ("environment image", |s| s.environment.image = texture(3.0)),
    ("no environment image", |s| s.environment.image = None),
    ("environment rotation", |s| s.environment.rotation = 90.0),
    ("camera", |s| s.camera.position.x = 1.0),
    ("target", |s| s.camera.target.x = 1.0),
    ("up", |s| s.camera.up.x = 1.0),
    ("field of view", |s| s.camera.vertical_fov = 41.0),
    ("depth", |s| s.max_depth = 7),
    ("pixel filter", |s| s.pixel_filter = PixelFilter::Center),
    ("textures for one another", |s| {
        let m = &mut s.materials[2];
        std::mem::swap(&mut m.color_texture, &mut m.emission_texture);
    }),
];

#[test]
fn changes_with_everything_that_decides_a_pixel() {
    let mut all = vec![("none", tiny().fingerprint())];
    for (what, change) in CHANGES {
        let mut scene = tiny();
        change(&mut scene);
        let fingerprint = scene.fingerprint();
        let same = all.iter().find(|(_, other)| *other == fingerprint);
        assert!(same.is_none(), "{what}: as with {same:?}");
        all.push((what, fingerprint));
    }
}

#[test]
fn does_not_change_with_anything_else() {
    let changes: [Change; 6] = [
        ("size", |s| s.size = [8, 9]),
        // It keeps the mean.
        ("roulette", |s| s.russian_roulette = false),
        ("names of materials", |s| s.materials[0].name = "n".into()),
        ("notes", |s| s.notes.push("a note".into())),
        ("inputs", |s| s.inputs.push("x.obj".into())),
        ("the sign of zero", |s| s.triangles[0].positions[0].x = -0.0),
    ];
    for (what, change) in changes {
        let mut scene = tiny();
        change(&mut scene);
        assert_eq!(scene.fingerprint(), tiny().fingerprint(), "{what}");
    }
}

/// The built-in networks and sequence files on disk name scenes by these very
/// characters. Whoever has to change this line changes what the hash covers: VERSION
/// must change too, and the weights files need the new names.
#[test]
fn stays_what_it_is() {
    assert_eq!(tiny().fingerprint(), "tiny:v2:f41d8358f858c0a4");
}

/// Lists of fields that are the same bytes when written without names and lengths.
#[test]
fn fields_are_not_confused() {
    let hash = |fill: &dyn Fn(&mut Fields)| {
        let mut fields = Fields::default();
        fill(&mut fields);
        fields.finish()
    };
    let hashes = [
        hash(&|f| f.text("a", "bc")),
        hash(&|f| f.text("ab", "c")),
        hash(&|f| f.text("", "abc")),
        hash(&|f| {
            f.text("a", "b");
            f.text("c", "");
        }),
        hash(&|f| f.numbers("a", [1.0, 2.0])),
        hash(&|f| {
            f.numbers("a", [1.0]);
            f.numbers("a", [2.0]);
        }),
        hash(&|f| {
            f.numbers("a", [1.0, 2.0]);
            f.numbers("a", []);
        }),
    ];
    for (i, hash) in hashes.iter().enumerate() {
        assert!(!hashes[..i].contains(hash), "{i}");
    }
}

/// Normals that move from one triangle to the other: the same numbers in the same order.
#[test]
fn triangles_are_not_confused() {
    let with = |which: usize| {
        let mut scene = tiny();
        scene.triangles[1].normals = None;
        scene.triangles[which].normals = Some([Vec3A::Z; 3]);
        scene.fingerprint()
    };
    assert_ne!(with(0), with(1));
}
