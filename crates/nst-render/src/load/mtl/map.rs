//! Statements that name images.

use std::path::{Path, PathBuf};

use super::{
    context::{Context, UNREADABLE},
    options::{self, Options},
};
use crate::{
    Error, TextureMap,
    load::{
        files::{find, is_found},
        maps::{Channel, Meaning, Values},
        report::Report,
        text::{COMMENT, Line, quoted, without_comment},
    },
};

/// An image, and how it is used.
pub(super) struct Map {
    pub(super) file: PathBuf,
    pub(super) options: Options,
    keyword: String,
    line: usize,
}

impl Map {
    /// What `map_Kd -options FILE` says; `None` if it names no file.
    ///
    /// # Errors
    /// Where loading is strict: what is wrong.
    pub(super) fn read(
        mtl: &Path,
        material: &str,
        line: &Line,
        report: &mut Report,
    ) -> Result<Option<Self>, Error> {
        let keyword = line.keyword();
        let material = quoted(material);
        let (mut options, mut name) = options::parse(mtl, line.name());
        let plain = without_comment(line.name());
        // A name may contain ` #`: it is a comment if there is no file of the whole name.
        if plain.len() < line.name().len() && !plain.is_empty() && !is_found(mtl, name, false) {
            report.forgive(COMMENT, mtl, line.number, || quoted(line.name()))?;
            (options, name) = options::parse(mtl, plain);
        }
        for fault in &options.faults {
            let kind = "options of textures that make no sense, left out";
            let fault = || format!("material {material}: {keyword}: {fault}");
            report.forgive(kind, mtl, line.number, fault)?;
        }
        for option in &options.unused {
            report.note(format!("option {option} of {keyword} left out"));
        }
        if name.is_empty() {
            let fault = || format!("material {material}: {keyword} names no file");
            report.forgive(UNREADABLE, mtl, line.number, fault)?;
            return Ok(None);
        }
        let file = find(mtl, name, report);
        Ok(Some(Self { file, options, keyword: keyword.to_owned(), line: line.number }))
    }

    /// The image as a texture; `None` if it is not there, or damaged. `channel` is the one to
    /// use if the options name none.
    ///
    /// # Errors
    /// Where loading is strict: why there is none.
    pub(super) fn texture(
        &self,
        material: &str,
        meaning: Meaning,
        channel: Option<Channel>,
        context: &mut Context,
    ) -> Result<Option<TextureMap>, Error> {
        let Options { scale, offset, clamp, values, .. } = self.options;
        let values = Values { channel: values.channel.or(channel), ..values };
        let fault = match std::fs::metadata(&self.file) {
            Err(error) => format!("cannot read '{}': {error}", self.file.display()),
            Ok(_) => match context.images.map(&self.file, meaning, values, context.report) {
                Ok(image) => return Ok(Some(TextureMap { image, scale, offset, clamp })),
                Err(error) => error.to_string(),
            },
        };
        let kind = "textures that are not there or cannot be read, left out";
        let fault = || format!("material {}: {}: {fault}", quoted(material), self.keyword);
        context.report.forgive(kind, context.path, self.line, fault)?;
        Ok(None)
    }
}
