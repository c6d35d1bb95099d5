//! Our triangles beside those that tobj reads from the same file.

use super::*;
use crate::load::exact::length_squared;
use crate::load::exact::unit_or_zero;

/// The triangles of a file of triangles and convex polygons, and which have normals and
/// texture coordinates; the numbers of its materials are those of their names in `names`,
/// and one more.
fn of_tobj(obj: &str, names: &[&str]) -> Vec<Triangle> {
    let options = tobj::LoadOptions::default();
    let materials =
        || Ok((vec![], (0..).zip(names).map(|(id, name)| (name.to_string(), id)).collect()));
    let (models, _) =
        tobj::load_obj_buf(&mut obj.as_bytes(), &options, |_| materials()).expect("a good file");
    models.iter().flat_map(|model| fans(&model.mesh, names.len())).collect()
}

fn fans(mesh: &tobj::Mesh, default: usize) -> Vec<Triangle> {
    let arities = match mesh.face_arities.as_slice() {
        [] => vec![3; mesh.indices.len() / 3],
        arities => arities.to_vec(),
    };
    let vector = |values: &[f32], index: u32| Vec3A::from_slice(&values[index as usize * 3..]);
    let mut triangles = Vec::new();
    let mut start = 0;
    for arity in arities {
        for i in 1..arity as usize - 1 {
            let corners = [0, i, i + 1].map(|i| start + i);
            let normal = |i: usize| unit_or_zero(vector(&mesh.normals, mesh.normal_indices[i]));
            let uv = |i: usize| {
                Vec2::from_slice(&mesh.texcoords[mesh.texcoord_indices[i] as usize * 2..])
            };
            triangles.push(Triangle {
                positions: corners.map(|i| vector(&mesh.positions, mesh.indices[i])),
                normals: (!mesh.normals.is_empty()).then(|| corners.map(normal)),
                uvs: (!mesh.texcoords.is_empty()).then(|| corners.map(uv)),
                material: mesh.material_id.unwrap_or(default) as u32,
            });
        }
        start += arity as usize;
    }
    triangles
}

/// −0 is 0, as both print it so.
fn assert_same(ours: &[Triangle], theirs: &[Triangle], what: &str) {
    assert_eq!(ours.len(), theirs.len(), "{what}");
    for (i, (ours, theirs)) in ours.iter().zip(theirs).enumerate() {
        assert_eq!(ours, theirs, "{what}, triangle {i}");
    }
}

/// The order of the triangles in tobj's models is that of the file.
#[test]
fn scenes_of_the_repository_are_read_as_tobj_does() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    let mut count = 0;
    for name in
        ["cornell", "teapot-diffuse", "teapot-glossy", "many-lights", "caustic", "plane-ggx"]
    {
        let path = folder.join(name).join(name).with_extension("obj");
        let scene = Scene::load(&path).expect("a scene of this repository");
        let names: Vec<_> = scene.materials.iter().map(|m| m.name.as_str()).collect();
        let text = std::fs::read_to_string(&path).expect("a text");
        assert_same(&scene.triangles, &of_tobj(&text, &names), name);
        count += scene.triangles.len();
    }
    assert!(count > 10_000, "{count}");
}

/// Numbers of a generator by Marsaglia (xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % n
    }

    /// Of up to 17 digits, with and without an exponent.
    fn number(&mut self) -> String {
        let digits = 10_u64.pow(1 + self.below(17) as u32);
        let fraction = self.below(digits) as f64 / digits as f64 - 0.5;
        match self.below(4) {
            0 => format!("{fraction}"),
            1 => format!("{fraction:.6}"),
            2 => format!("{fraction:e}"),
            _ => format!("{:.3}", fraction * 100.0),
        }
    }
}

/// A file of triangles with everything that both read: sparse spaces, comments, relative
/// numbers, groups. All its vertices have normals and texture coordinates.
fn random_file(seed: u64) -> String {
    let mut random = Random(seed);
    let mut obj = "mtllib x.mtl\n# random\n".to_owned();
    let mut count = 0;
    for block in 0..20 {
        let new = 3 + random.below(20);
        for _ in 0..new {
            let mut number = || random.number();
            let numbers: Vec<_> = (0..8).map(|_| number()).collect();
            let [x, y, z, u, v, a, b, c] = &numbers[..] else { panic!("eight") };
            obj += &format!("v  {x} {y}\t{z} \nvt {u} {v}\nvn {a} {b} {c}\n");
        }
        count += new;
        obj += ["g a\n", "o b\n", "usemtl m\n", "usemtl n n\n", "s 1\n"][block % 5];
        for _ in 0..random.below(30) {
            let mut corner = || {
                let [v, vt, vn] = [(); 3].map(|()| {
                    let i = random.below(count) as i64;
                    if i % 3 == 0 { i - count as i64 } else { i + 1 }
                });
                format!("{v}/{vt}/{vn}")
            };
            obj += &format!("f {} {}  {}\r\n", corner(), corner(), corner());
        }
    }
    obj
}

#[test]
fn random_files_are_read_as_tobj_does() {
    let mut count = 0;
    for seed in 1..200 {
        let obj = random_file(seed << 32 | seed);
        let scene = load(&[("x.obj", &obj), ("x.mtl", "newmtl m\nnewmtl n n\n")]).expect("good");
        let mut theirs = of_tobj(&obj, &["m", "n n"]);
        theirs.retain(|triangle| length_squared(triangle.area_vector()).is_normal());
        assert_same(&scene.triangles, &theirs, &obj);
        count += theirs.len();
    }
    assert!(count > 30_000, "{count}");
}

/// The comparison sees a digit, a corner and a material.
#[test]
fn the_comparison_sees_differences() {
    let obj = random_file(7);
    let theirs = of_tobj(&obj, &["m"]);
    let changes: [fn(&mut Triangle); 4] = [
        |t| t.positions[1].y = t.positions[1].y.next_up(),
        |t| t.normals = None,
        |t| t.uvs.iter_mut().for_each(|uvs| uvs.swap(0, 1)),
        |t| t.material += 1,
    ];
    for change in changes {
        let mut ours = theirs.clone();
        change(&mut ours[17]);
        let seen = std::panic::catch_unwind(|| assert_same(&ours, &theirs, "changed"));
        assert!(seen.is_err());
    }
    assert!(std::panic::catch_unwind(|| assert_same(&theirs[1..], &theirs, "cut")).is_err());
}
