//! OBJ text that tobj can take.
//!
//! tobj makes up normals where a face has none, takes lines for faces, knows no
//! line continuations, panics on some numbers, and never says where an error is.
//! So the text is checked here, line by line, and rewritten in the plainest form
//! of the format.

use std::{
    collections::{BTreeSet, HashMap},
    fmt::Write,
    path::Path,
};

use super::{
    report::Report,
    text::{self, Line, error_at, number, quoted},
};
use crate::Error;

/// An OBJ file in its plainest form.
pub(super) struct Tidied {
    /// All vertices, then all faces; each corner of a face names a vertex, a
    /// texture coordinate and a normal by positive numbers. The first texture
    /// coordinate is NaN and the first normal zero: they stand for missing ones.
    /// Materials are named by their numbers.
    pub(super) text: String,
    /// Names of materials that there are none of.
    pub(super) unknown: BTreeSet<String>,
    pub(super) losses: Losses,
}

/// How much of a file nothing is made of.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Losses {
    /// Faces of less than three corners.
    short_faces: usize,
    /// Lines, points, curves and surfaces.
    other_elements: usize,
    /// Normals of length zero.
    zero_normals: usize,
    /// Texture coordinates from [`WHOLE`] on.
    whole_uvs: usize,
}

impl Losses {
    /// A note of each kind that there is.
    pub(super) fn note(&self, report: &mut Report) {
        for (count, what) in [
            (self.short_faces, "faces of fewer than three corners, left out"),
            (self.other_elements, "points, lines, curves and surfaces, left out"),
            (self.zero_normals, "normals of length zero, where the surface is flat"),
            (self.whole_uvs, "texture coordinates too large to have a fraction, set to 0"),
        ] {
            if count > 0 {
                report.note(format!("{what}: {count}"));
            }
        }
    }
}

/// Texture coordinates from here on have no fraction in f32, so no place in a texture.
pub(super) const WHOLE: f32 = 8_388_608.0;

/// What the three numbers of a face's corner refer to.
const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// How many vertices, texture coordinates and normals there are so far, and
/// which faces are ahead of them.
#[derive(Default)]
struct Counts {
    counts: [i64; 3],
    /// Line, kind and number.
    ahead: Vec<(usize, usize, i64)>,
}

/// Checks and rewrites an OBJ file, given the numbers of its materials.
///
/// # Errors
/// Names the first line that is malformed.
pub(super) fn tidy(
    path: &Path,
    text: &str,
    materials: &HashMap<&str, u32>,
) -> Result<Tidied, Error> {
    let mut vertices = "mtllib all\nvt nan nan\nvn 0 0 0\n".to_owned();
    let mut faces = String::new();
    let mut counts = Counts::default();
    let mut unknown = BTreeSet::new();
    let mut losses = Losses::default();
    for line in text::lines(text) {
        let result = match line.keyword() {
            "v" => vertex(&line, &mut vertices).map(|()| counts.counts[0] += 1),
            "vt" => texture(&line, &mut vertices).map(|uv| {
                counts.counts[1] += 1;
                losses.whole_uvs += usize::from(uv.iter().any(|x| x.abs() >= WHOLE));
            }),
            "vn" => numbers(&line, "vn", "normal", 3, &mut vertices).map(|normal| {
                counts.counts[2] += 1;
                losses.zero_normals += usize::from(normal.iter().all(|&x| x == 0.0));
            }),
            "f" if line.words().count() < 3 => {
                losses.short_faces += 1;
                Ok(())
            }
            "f" => face(&line, &mut counts, &mut faces),
            "usemtl" if line.name().is_empty() => Err("usemtl without a name".to_owned()),
            "usemtl" => {
                if let Some(id) = materials.get(line.name()) {
                    append(&mut faces, format_args!("usemtl {id}\n"));
                } else {
                    append(&mut faces, format_args!("usemtl unknown\n"));
                    unknown.insert(line.name().to_owned());
                }
                Ok(())
            }
            "p" | "l" | "curv" | "curv2" | "surf" => {
                losses.other_elements += 1;
                Ok(())
            }
            // Names of objects and groups, smoothing groups, and what programs add.
            _ => Ok(()),
        };
        result.map_err(|message| line.error(path, message))?;
    }
    counts.check(path)?;
    vertices.push_str(&faces);
    Ok(Tidied { text: vertices, unknown, losses })
}

fn append(text: &mut String, arguments: std::fmt::Arguments) {
    text.write_fmt(arguments).expect("a string takes anything");
}

/// Three numbers, and a fourth that divides them if no colour follows.
fn vertex(line: &Line, vertices: &mut String) -> Result<(), String> {
    let xyz = numbers(line, "v", "vertex", 3, vertices)?;
    if line.words().count() == 4 {
        let word = line.words().nth(3).unwrap_or_default(); // there is one
        let w = number("vertex weight", word)?;
        if !xyz.iter().all(|x| (x / w).is_finite()) {
            return Err(format!("vertex divided by its weight {} is not finite", quoted(word)));
        }
        vertices.pop();
        append(vertices, format_args!(" {word}\n"));
    }
    Ok(())
}

/// One or two numbers; a third has no use for images.
fn texture(line: &Line, vertices: &mut String) -> Result<Vec<f32>, String> {
    if line.words().count() == 1 {
        let u = numbers(line, "vt", "texture coordinate", 1, vertices)?;
        vertices.pop();
        vertices.push_str(" 0\n");
        Ok(u)
    } else {
        numbers(line, "vt", "texture coordinate", 2, vertices)
    }
}

/// Copies the first `count` numbers, and returns them.
fn numbers(
    line: &Line,
    keyword: &str,
    what: &str,
    count: usize,
    to: &mut String,
) -> Result<Vec<f32>, String> {
    to.push_str(keyword);
    let mut values = Vec::with_capacity(count);
    for word in line.words().take(count) {
        values.push(number(what, word)?);
        append(to, format_args!(" {word}"));
    }
    to.push('\n');
    if values.len() < count {
        return Err(format!("{what} of {} numbers instead of {count}", values.len()));
    }
    Ok(values)
}

fn face(line: &Line, counts: &mut Counts, faces: &mut String) -> Result<(), String> {
    faces.push('f');
    for word in line.words() {
        // Missing numbers refer to what stands for missing ones.
        let mut indices = [0, 1, 1];
        for (kind, part) in word.split('/').enumerate() {
            if kind > 2 {
                return Err(format!("face corner {} has more than three numbers", quoted(word)));
            }
            if part.is_empty() && kind > 0 {
                continue;
            }
            let index = part
                .parse()
                .map_err(|_| format!("face corner {} is not made of numbers", quoted(word)))?;
            indices[kind] = counts.resolve(line.number, kind, index)?;
            if kind > 0 {
                indices[kind] += 1;
            }
        }
        let [v, vt, vn] = indices;
        append(faces, format_args!(" {v}/{vt}/{vn}"));
    }
    faces.push('\n');
    Ok(())
}

impl Counts {
    /// The number from 1 on: negative ones count back from the last.
    fn resolve(&mut self, line: usize, kind: usize, index: i64) -> Result<i64, String> {
        let count = self.counts[kind];
        let what = KINDS[kind];
        match index {
            0 => Err(format!("a face names {what} 0; they count from 1")),
            ..0 if index < -count => {
                Err(format!("a face names {what} {index}, but there are only {count} before it"))
            }
            ..0 => Ok(count + index + 1),
            _ => {
                if index > count {
                    self.ahead.push((line, kind, index));
                }
                // Refused by `check`, so that it may as well not overflow.
                Ok(index.min(i64::MAX - 1))
            }
        }
    }

    /// Whether everything that was ahead has come.
    fn check(&self, path: &Path) -> Result<(), Error> {
        let missing = |&&(_, kind, index): &&(usize, usize, i64)| index > self.counts[kind];
        match self.ahead.iter().find(missing) {
            None => Ok(()),
            Some(&(line, kind, index)) => {
                let (what, count) = (KINDS[kind], self.counts[kind]);
                let message = format!("a face names {what} {index}, but there are only {count}");
                Err(error_at(path, line, message))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tidied(text: &str) -> Result<Tidied, String> {
        let materials = HashMap::from([("a wall", 3)]);
        tidy(Path::new("x.obj"), text, &materials).map_err(|error| error.to_string())
    }

    #[test]
    fn rewrites_everything_in_one_form() {
        let text = "\
            f 1 2/1 4//1\nv 1 2 3 # first\nv 1 2 3 4\nv 1 2 3 .1 .2 .3\nv 0 0 0 1 1\nvt 5\n\
            vt 5 6 7\nvn 0 0 1\n usemtl\ta wall \nusemtl gone\nf -1/-1/-1 2/2/ -2//1\nl 1 2 3\nf 1 2\n\
            vn 0 0 0\nvt 1e7 0\n";
        let tidied = tidied(text).expect("good text");
        let expected = "\
            mtllib all\nvt nan nan\nvn 0 0 0\nv 1 2 3\nv 1 2 3 4\nv 1 2 3\nv 0 0 0\nvt 5 0\nvt 5 6\n\
            vn 0 0 1\nvn 0 0 0\nvt 1e7 0\nf 1/1/1 2/2/1 4/1/2\nusemtl 3\nusemtl unknown\nf 4/3/2 2/3/1 3/1/2\n";
        assert_eq!(tidied.text, expected);
        assert_eq!(tidied.unknown, ["gone".to_owned()].into());
        let losses = Losses { short_faces: 1, other_elements: 1, zero_normals: 1, whole_uvs: 1 };
        assert_eq!(tidied.losses, losses);
    }

    #[test]
    fn errors_name_the_line() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        let cases = [
            ("f 1 2 9", "line 4: a face names vertex 9, but there are only 3"),
            ("f 1 2 -4", "line 4: a face names vertex -4"),
            ("f 1 2 0", "line 4: a face names vertex 0"),
            ("f 1/1 2/1 3/1", "line 4: a face names texture coordinate 1"),
            ("f 1//-1 2//1 3//1", "line 4: a face names normal -1"),
            ("f 1 2 9223372036854775807", "line 4: a face names vertex 9223372036854775807"),
            ("f 1 2 -9223372036854775808", "line 4: a face names vertex -92"),
            ("f 1 2 99999999999999999999", "line 4: face corner '99999999999999999999'"),
            ("f 1 2 3/1/1/1", "line 4: face corner '3/1/1/1' has more"),
            ("f 1 2 c", "line 4: face corner 'c'"),
            ("f 1 2 /3", "line 4: face corner '/3'"),
            ("\n\nv 0 zero 0", "line 6: vertex 'zero' is not a number"),
            ("v 0 0", "line 4: vertex of 2 numbers instead of 3"),
            ("v 0 0 1e39", "line 4: vertex '1e39' is not finite"),
            ("v 0 0 1 0", "line 4: vertex divided by its weight"),
            ("v 0 1e30 1 1e-30", "line 4: vertex divided by its weight"),
            ("vt nan 0", "line 4: texture coordinate 'nan' is not finite"),
            ("vt", "line 4: texture coordinate of 0 numbers"),
            ("vn 0 inf 0", "line 4: normal 'inf' is not finite"),
            ("usemtl", "line 4: usemtl without a name"),
        ];
        for (line, words) in cases {
            let error = tidied(&format!("{vertices}{line}\n")).err().unwrap_or_default();
            assert!(error.contains(words), "{line}: {error}");
        }
    }
}
