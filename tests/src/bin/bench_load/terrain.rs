//! A terrain as an OBJ file.

use std::fmt::Write;

/// Squares along the side of a tile: the heights, and so the normals, repeat from tile to
/// tile, and each tile shows the whole texture.
const TILE: u32 = 8;

/// Hills, 2 `squares`² triangles with normals and texture coordinates.
pub(crate) fn obj(squares: u32) -> String {
    let mut obj = "# hills\no terrain\n".to_owned();
    let mut line = |arguments: std::fmt::Arguments<'_>| {
        obj.write_fmt(arguments).expect("a string takes anything");
    };
    for z in 0..=squares {
        for x in 0..=squares {
            let [height, ..] = surface(x, z);
            line(format_args!("v {:.6} {height:.6} {:.6}\n", coordinate(x), coordinate(z)));
        }
    }
    for z in 0..=TILE {
        for x in 0..=TILE {
            let [u, v] = [x, z].map(|i| f64::from(i) / f64::from(TILE));
            let [_, dx, dz] = surface(x, z);
            line(format_args!("vt {u:.6} {v:.6}\nvn {:.6} 1.000000 {:.6}\n", -dx, -dz));
        }
    }
    for z in 0..squares {
        for x in 0..squares {
            let corner = |dx: u32, dz: u32| {
                let vertex = (z + dz) * (squares + 1) + x + dx + 1;
                let other = (z % TILE + dz) * (TILE + 1) + x % TILE + dx + 1;
                [vertex, other, other]
            };
            let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
            for [[a, ta, na], [b, tb, nb], [c, tc, nc]] in [[a, c, b], [a, d, c]] {
                line(format_args!("f {a}/{ta}/{na} {b}/{tb}/{nb} {c}/{tc}/{nc}\n"));
            }
        }
    }
    obj
}

fn coordinate(i: u32) -> f64 {
    f64::from(i) * 0.1
}

/// The height, and its slopes in x and z.
fn surface(x: u32, z: u32) -> [f64; 3] {
    let turn = std::f64::consts::TAU / f64::from(TILE);
    let [a, b] = [x, z].map(|i| f64::from(i) * turn);
    let steep = 0.2 * turn / coordinate(1);
    [0.2 * a.sin() * b.sin(), steep * a.cos() * b.sin(), steep * a.sin() * b.cos()]
}
