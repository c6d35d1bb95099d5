//! The statements of an OBJ file, read in one pass.

use std::{collections::HashMap, path::Path};

use glam::{DVec3, Vec2, Vec3, Vec3A};

use super::{
    super::{
        exact::unit_or_zero,
        report::Report,
        text::{self, Line, Text, quoted},
    },
    keywords::Statement,
    words::{Corner, Words, corner, number_f32, number_f64},
};
use crate::Error;

/// Texture coordinates from here on have no fraction in f32, so no place in a texture.
const WHOLE: f32 = 8_388_608.0;

/// What the three numbers of a face's corner refer to.
pub(super) const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

/// The kind of a fault, by what the number refers to.
pub(super) const MISSING: [&str; 3] = [
    "",
    "corners whose texture coordinate is not there, read as without one",
    "corners whose normal is not there, where the surface is flat",
];

/// What an OBJ file contains.
#[derive(Default)]
pub(super) struct Contents {
    /// NaN where a vertex is not finite.
    pub(super) positions: Vec<DVec3>,
    /// The vertices that are not finite, in order.
    pub(super) bad: Vec<Bad>,
    /// As they stand in the file, by vertex, NaN where it has none; of the first vertices
    /// alone, up to the last that has one.
    pub(super) colors: Vec<[f32; 3]>,
    /// NaN where they are not finite.
    pub(super) uvs: Vec<Vec2>,
    /// Unit vectors, or zero.
    pub(super) normals: Vec<Vec3>,
    pub(super) faces: Vec<Face>,
    /// Of all faces: numbers of vertex, texture coordinate and normal, from 1; 0 for none.
    pub(super) corners: Vec<[u32; 3]>,
    /// A vertex that u32 has no number for.
    pub(super) beyond: Option<i64>,
    /// The names of `usemtl` statements, each once, with the first line of each.
    pub(super) materials: Vec<(usize, String)>,
    /// The lines and names of `mtllib` statements.
    pub(super) libraries: Vec<(usize, String)>,
    losses: Losses,
}

/// A face of at least three corners.
pub(super) struct Face {
    pub(super) line: usize,
    /// Behind its last corner.
    pub(super) end: usize,
    /// An index into [`Contents::materials`], if it is one.
    pub(super) material: u32,
}

/// A vertex that is not finite.
pub(super) struct Bad {
    pub(super) index: usize,
    pub(super) line: usize,
    /// What is wrong, behind "vertex 1".
    pub(super) fault: &'static str,
}

/// How much of a file nothing is made of.
#[derive(Debug, Default, PartialEq)]
struct Losses {
    /// Faces of less than three corners.
    short_faces: usize,
    /// Lines, points, curves and surfaces.
    other_elements: usize,
    /// Normals of length zero.
    zero_normals: usize,
    /// Texture coordinates from [`WHOLE`] on.
    whole_uvs: usize,
}

impl Contents {
    /// Reads all statements.
    ///
    /// # Errors
    /// Names the first line that is malformed.
    pub(super) fn read(path: &Path, text: &Text, report: &mut Report) -> Result<Self, Error> {
        let mut reader = Reader {
            path,
            report,
            contents: Self::default(),
            names: HashMap::new(),
            material: u32::MAX,
        };
        for line in text::lines(text) {
            reader.statement(&line)?;
        }
        Ok(reader.contents)
    }

    /// How many points, lines, curves and surfaces the file has.
    pub(super) fn other_elements(&self) -> usize {
        self.losses.other_elements
    }

    /// A note of each kind of loss that there is.
    pub(super) fn note_losses(&self, report: &mut Report) {
        let losses = &self.losses;
        for (count, what) in [
            (losses.short_faces, "faces of fewer than three corners, left out"),
            (losses.other_elements, "points, lines, curves and surfaces, left out"),
            (losses.zero_normals, "normals of length zero, where the surface is flat"),
            (losses.whole_uvs, "texture coordinates too large to have a fraction, set to 0"),
        ] {
            if count > 0 {
                report.note(format!("{what}: {count}"));
            }
        }
    }
}

struct Reader<'a> {
    path: &'a Path,
    report: &'a mut Report,
    contents: Contents,
    /// The indices of [`Contents::materials`].
    names: HashMap<String, u32>,
    /// The one in use.
    material: u32,
}

impl Reader<'_> {
    fn statement(&mut self, line: &Line) -> Result<(), Error> {
        let text = line.plain();
        let mut words = Words::new(&text);
        let Some(keyword) = words.next() else { return Ok(()) };
        let Some(statement) = self.keyword(keyword, line.number)? else { return Ok(()) };
        match statement {
            Statement::Vertex => self.vertex(words, line),
            Statement::Texture => self.texture(words, line.number),
            Statement::Normal => self.normal(words, line.number),
            Statement::Face => self.face(words, line),
            Statement::ObsoleteFace => {
                self.forgive("the obsolete 'fo', read as 'f'", line.number, || {
                    "'fo' is obsolete".to_owned()
                })?;
                self.face(words, line)
            }
            Statement::Material => self.use_material(line),
            Statement::Library => self.library(line),
            Statement::Element => {
                self.contents.losses.other_elements += 1;
                Ok(())
            }
            Statement::Call => {
                let fault = || format!("{} is not obeyed", quoted(keyword));
                self.forgive("calls of other files and programs, left out", line.number, fault)
            }
            Statement::Harmless => Ok(()),
        }
    }

    /// What a keyword means; `None` if that is unknown.
    #[inline]
    fn keyword(&mut self, keyword: &str, line: usize) -> Result<Option<Statement>, Error> {
        if let Some(statement) = Statement::of(keyword) {
            return Ok(Some(statement));
        }
        let statement = Statement::of(&keyword.to_ascii_lowercase());
        let (kind, what) = match statement {
            Some(_) => ("keywords in upper case, read as those in lower case", "is in upper case"),
            None => ("statements with unknown keywords, left out", "is unknown"),
        };
        self.forgive(kind, line, || format!("keyword {} {what}", quoted(keyword)))?;
        Ok(statement)
    }

    fn forgive(
        &mut self,
        kind: &str,
        line: usize,
        fault: impl FnOnce() -> String,
    ) -> Result<(), Error> {
        self.report.forgive(kind, self.path, line, fault)
    }

    /// Three numbers; then nothing, a weight that divides them, or a colour and its opacity.
    fn vertex(&mut self, words: Words, line: &Line) -> Result<(), Error> {
        let mut numbers = [0.0; 7];
        let mut count = 0;
        for (number, word) in numbers.iter_mut().zip(words) {
            match number_f64(word) {
                Some(x) => *number = x,
                None if count >= 3 => {
                    let fault = || format!("{} behind a vertex is no number", quoted(word));
                    self.forgive(BEHIND, line.number, fault)?;
                    count = 3;
                    break;
                }
                None => {
                    let hint = if word.contains(',') { "; decimals need a point" } else { "" };
                    let message = format!("vertex {} is not a number{hint}", quoted(word));
                    return Err(line.error(self.path, message));
                }
            }
            count += 1;
        }
        if count < 3 {
            return Err(line.error(self.path, format!("vertex of {count} numbers instead of 3")));
        }
        let [x, y, z, w, ..] = numbers;
        self.position(DVec3::new(x, y, z), (count == 4).then_some(w), line.number);
        if count >= 6 {
            let colors = &mut self.contents.colors;
            colors.resize(self.contents.positions.len() - 1, [f32::NAN; 3]);
            colors.push([numbers[3], numbers[4], numbers[5]].map(|x| x as f32));
        }
        Ok(())
    }

    #[inline]
    fn position(&mut self, xyz: DVec3, weight: Option<f64>, line: usize) {
        let mut position = xyz;
        let mut fault = "is not finite";
        if let Some(w) = weight.filter(|&w| w != 1.0) {
            // In f32, as most readers do.
            position = (xyz.as_vec3() / w as f32).as_dvec3();
            fault = "divided by its weight is not finite";
        }
        if !position.as_vec3().is_finite() {
            if position.is_finite() {
                fault = "is not finite: beyond 3.4e38";
            }
            self.contents.bad.push(Bad { index: self.contents.positions.len(), line, fault });
            position = DVec3::NAN;
        }
        self.contents.positions.push(position);
    }

    /// One or two numbers; a third has no use for images.
    fn texture(&mut self, mut words: Words, line: usize) -> Result<(), Error> {
        let u = words.next().and_then(number_f32);
        let v = words.next().map_or(Some(0.0), number_f32);
        let uv = Vec2::new(u.unwrap_or(f32::NAN), v.unwrap_or(f32::NAN));
        let whole = uv.abs().cmpge(Vec2::splat(WHOLE));
        if !uv.is_finite() {
            let kind = "texture coordinates that are not finite numbers, read as missing";
            let number = self.contents.uvs.len() + 1;
            self.forgive(kind, line, || format!("texture coordinate {number} is not finite"))?;
            self.contents.uvs.push(Vec2::NAN);
            return Ok(());
        }
        self.contents.losses.whole_uvs += usize::from(whole.any());
        self.contents.uvs.push(Vec2::select(whole, Vec2::ZERO, uv));
        Ok(())
    }

    fn normal(&mut self, mut words: Words, line: usize) -> Result<(), Error> {
        let mut xyz = [f32::NAN; 3];
        for x in &mut xyz {
            *x = words.next().and_then(number_f32).unwrap_or(f32::NAN);
        }
        let mut normal = Vec3A::from(xyz);
        if !normal.is_finite() {
            let kind = "normals that are not three finite numbers, where the surface is flat";
            let number = self.contents.normals.len() + 1;
            self.forgive(kind, line, || format!("normal {number} is not finite"))?;
            normal = Vec3A::ZERO;
        } else if normal == Vec3A::ZERO {
            self.contents.losses.zero_normals += 1;
        }
        self.contents.normals.push(unit_or_zero(normal).into());
        Ok(())
    }

    fn face(&mut self, words: Words, line: &Line) -> Result<(), Error> {
        let start = self.contents.corners.len();
        let read = self.corners(words.clone(), line);
        if read.is_err() && words.count() >= 3 {
            return read;
        }
        if read.is_err() || self.contents.corners.len() < start + 3 {
            self.contents.corners.truncate(start);
            self.contents.losses.short_faces += 1;
            return Ok(());
        }
        let end = self.contents.corners.len();
        self.contents.faces.push(Face { line: line.number, end, material: self.material });
        Ok(())
    }

    fn corners(&mut self, words: Words, line: &Line) -> Result<(), Error> {
        let start = self.contents.corners.len();
        for word in words {
            match corner(word) {
                Ok(corner) => {
                    let resolved = self.resolve(corner, line)?;
                    self.contents.corners.push(resolved);
                }
                Err(_) if self.contents.corners.len() >= start + 3 => {
                    let fault = || format!("{} behind a face is no corner", quoted(word));
                    return self.forgive(BEHIND, line.number, fault);
                }
                Err(fault) => {
                    let message = format!("face corner {} {fault}", quoted(word));
                    return Err(line.error(self.path, message));
                }
            }
        }
        Ok(())
    }

    /// The corner's numbers from 1 on: negative ones count back from the last.
    #[inline]
    fn resolve(&mut self, corner: Corner, line: &Line) -> Result<[u32; 3], Error> {
        let contents = &self.contents;
        let counts = [contents.positions.len(), contents.uvs.len(), contents.normals.len()];
        let mut numbers = [0; 3];
        for (kind, number) in numbers.iter_mut().enumerate() {
            let count = counts[kind] as i64;
            match corner[kind] {
                None => {}
                Some(index @ 1..) => *number = u32::try_from(index).unwrap_or(u32::MAX),
                Some(index) if index < 0 && index >= -count => {
                    *number = u32::try_from(count + index + 1).unwrap_or(u32::MAX);
                }
                Some(index) => {
                    let what = KINDS[kind];
                    let fault = || match index {
                        0 => format!("a face names {what} 0; they count from 1"),
                        _ => format!(
                            "a face names {what} {index}, but there are only {count} before it"
                        ),
                    };
                    if kind == 0 {
                        return Err(line.error(self.path, fault()));
                    }
                    self.forgive(MISSING[kind], line.number, fault)?;
                }
            }
        }
        if numbers[0] == u32::MAX && self.contents.beyond.is_none() {
            self.contents.beyond = corner[0];
        }
        Ok(numbers)
    }

    fn use_material(&mut self, line: &Line) -> Result<(), Error> {
        let name = line.name();
        if name.is_empty() {
            let kind = "usemtl without a name: the default material";
            self.forgive(kind, line.number, || "usemtl without a name".to_owned())?;
        }
        let known = self.names.get(name).copied();
        self.material = known.unwrap_or_else(|| {
            let new = self.contents.materials.len() as u32;
            self.contents.materials.push((line.number, name.to_owned()));
            self.names.insert(name.to_owned(), new);
            new
        });
        Ok(())
    }

    fn library(&mut self, line: &Line) -> Result<(), Error> {
        if line.name().is_empty() {
            let kind = "mtllib without a name, left out";
            return self.forgive(kind, line.number, || "mtllib without a name".to_owned());
        }
        self.contents.libraries.push((line.number, line.name().to_owned()));
        Ok(())
    }
}

const BEHIND: &str = "words that are no numbers behind vertices and faces, left out";
