//! What the statements of an MTL file say, one by one.

use std::{ops::RangeInclusive, path::Path};

use glam::Vec3A;

use super::{
    context::{OUT_OF_RANGE, UNREADABLE},
    map::Map,
};
use crate::{
    Error,
    load::{
        ranges::{FINITE, NOT_NEGATIVE, RADIANCE, UNIT},
        report::Report,
        text::{Line, number_within, quoted},
    },
};

/// Keys that change the look of a surface, but that nothing here reads, beside those that
/// begin with `map_`.
const NOTED: [&str; 3] = ["disp", "decal", "refl"];

/// What a material's statements say, in the file's own terms.
#[derive(Default)]
pub(super) struct Statements {
    pub(super) name: String,
    pub(super) kd: Option<Vec3A>,
    pub(super) ks: Option<Vec3A>,
    pub(super) ke: Option<Vec3A>,
    /// The colour of the light that passes.
    pub(super) tf: Option<Vec3A>,
    pub(super) ns: Option<f32>,
    /// With its line, as its range depends on other statements.
    pub(super) ni: Option<(usize, f32)>,
    /// Opacity.
    pub(super) d: Option<f32>,
    /// One minus opacity; `d` takes precedence.
    pub(super) tr: Option<f32>,
    pub(super) illum: u32,
    pub(super) pr: Option<f32>,
    pub(super) pm: Option<f32>,
    pub(super) ps: Option<f32>,
    pub(super) pc: Option<f32>,
    pub(super) pcr: Option<f32>,
    pub(super) aniso: Option<f32>,
    pub(super) map_kd: Option<Map>,
    pub(super) map_ke: Option<Map>,
    pub(super) map_d: Option<Map>,
    pub(super) bump: Option<Map>,
    pub(super) norm: Option<Map>,
}

/// A statement of a material.
struct Statement<'a> {
    path: &'a Path,
    material: &'a str,
    line: &'a Line<'a>,
    report: &'a mut Report,
}

impl Statements {
    /// Reads a statement. Keys that are not in the list are left out: there is no end
    /// of them, and [`NOTED`] has those that one would miss.
    ///
    /// # Errors
    /// Where loading is strict: names the line and what is wrong.
    pub(super) fn read(
        &mut self,
        path: &Path,
        key: &str,
        line: &Line,
        report: &mut Report,
    ) -> Result<(), Error> {
        let mut statement = Statement { path, material: &self.name, line, report };
        match key {
            "kd" => self.kd = statement.color(&UNIT)?.or(self.kd.take()),
            "ks" => self.ks = statement.color(&UNIT)?.or(self.ks.take()),
            "ke" => self.ke = statement.color(&RADIANCE)?.or(self.ke.take()),
            "tf" => self.tf = statement.color(&UNIT)?.or(self.tf.take()),
            "ns" => self.ns = statement.number(&NOT_NEGATIVE)?.or(self.ns.take()),
            "ni" => self.ni = statement.number(&FINITE)?.map(|ni| (line.number, ni)),
            "d" => self.d = statement.number(&UNIT)?.or(self.d.take()),
            "tr" => self.tr = statement.number(&UNIT)?.or(self.tr.take()),
            "illum" => self.illum = statement.model()?,
            "pr" => self.pr = statement.number(&UNIT)?.or(self.pr.take()),
            "pm" => self.pm = statement.number(&UNIT)?.or(self.pm.take()),
            "ps" => self.ps = statement.number(&UNIT)?.or(self.ps.take()),
            "pc" => self.pc = statement.number(&UNIT)?.or(self.pc.take()),
            "pcr" => self.pcr = statement.number(&UNIT)?.or(self.pcr.take()),
            "aniso" => self.aniso = statement.number(&UNIT)?.or(self.aniso.take()),
            "map_kd" => self.map_kd = statement.map()?.or(self.map_kd.take()),
            "map_ke" => self.map_ke = statement.map()?.or(self.map_ke.take()),
            "map_d" => self.map_d = statement.map()?.or(self.map_d.take()),
            "bump" | "map_bump" => self.bump = statement.map()?.or(self.bump.take()),
            "norm" | "map_norm" | "map_kn" => self.norm = statement.map()?.or(self.norm.take()),
            _ if NOTED.contains(&key) || key.starts_with("map_") => {
                report.note(format!("{} left out", line.keyword()));
            }
            _ => {}
        }
        Ok(())
    }
}

impl Statement<'_> {
    fn fault(&mut self, kind: &str, message: &str) -> Result<(), Error> {
        let fault = || format!("material {}: {message}", quoted(self.material));
        self.report.forgive(kind, self.path, self.line.number, fault)
    }

    /// The number that a word is, or the nearest one in the range; `None` if it is no number.
    fn value(&mut self, word: &str, range: &RangeInclusive<f32>) -> Result<Option<f32>, Error> {
        match number_within(self.line.keyword(), word, range) {
            Ok(number) => Ok(Some(number)),
            Err(message) => {
                let number = word.parse::<f32>().ok().filter(|number| !number.is_nan());
                let kind = if number.is_some() { OUT_OF_RANGE } else { UNREADABLE };
                self.fault(kind, &message)?;
                Ok(number.map(|number| number.clamp(*range.start(), *range.end())))
            }
        }
    }

    fn number(&mut self, range: &RangeInclusive<f32>) -> Result<Option<f32>, Error> {
        let line = self.line;
        let mut words = line.words().peekable();
        if words.next_if(|&word| word.eq_ignore_ascii_case("-halo")).is_some() {
            self.report.note(format!("option -halo of {} left out", line.keyword()));
        }
        let Some(word) = words.next() else {
            self.fault(UNREADABLE, &format!("{} without a number", line.keyword()))?;
            return Ok(None);
        };
        self.value(word, range)
    }

    /// The illumination model; 0, that of a statement that there is not, if there is none of
    /// its number.
    fn model(&mut self) -> Result<u32, Error> {
        const MODELS: RangeInclusive<f32> = 0.0..=10.0;
        let line = self.line;
        let Some(word) = line.words().next() else {
            self.fault(UNREADABLE, "illum without a number")?;
            return Ok(0);
        };
        match number_within(line.keyword(), word, &MODELS) {
            Ok(model) => Ok(model as u32),
            Err(message) => self.fault(UNREADABLE, &message).map(|()| 0),
        }
    }

    /// Three numbers, or one for grey. Of two, the second counts twice.
    fn color(&mut self, range: &RangeInclusive<f32>) -> Result<Option<Vec3A>, Error> {
        let line = self.line;
        let mut rgb = Vec::with_capacity(3);
        for word in line.words().take(3) {
            let Some(channel) = self.value(word, range)? else { return Ok(None) };
            rgb.push(channel);
        }
        if rgb.is_empty() || rgb.len() == 2 {
            let (keyword, count) = (line.keyword(), rgb.len());
            let message = format!("{keyword} is of {count} numbers instead of three");
            let kind = if count == 0 {
                UNREADABLE
            } else {
                "colours of two numbers, the second counts twice"
            };
            self.fault(kind, &message)?;
        }
        let Some(&last) = rgb.last() else { return Ok(None) };
        rgb.resize(3, last);
        Ok(Some(Vec3A::from_slice(&rgb)))
    }

    fn map(&mut self) -> Result<Option<Map>, Error> {
        Map::read(self.path, self.material, self.line, self.report)
    }
}
