//! The outputs of a job, none of which may replace anything that matters.

mod kind;

use std::path::{Path, PathBuf};

use crate::{Error, output_file::OutputFile};

pub use kind::{Kind, Name};

/// The outputs of a job. None may replace an input of the job, another output, or a file of
/// another kind.
#[derive(Debug, Default)]
pub struct Outputs {
    /// The inputs, and the outputs so far: where they are, the path as it was given, and
    /// what messages call them.
    taken: Vec<(PathBuf, PathBuf, &'static str)>,
}

impl Outputs {
    /// The outputs of a job that reads these files.
    pub fn of_inputs<P: AsRef<Path>>(inputs: impl IntoIterator<Item = P>) -> Self {
        let place = |path: P| {
            let path = path.as_ref();
            // A file that does not exist cannot be replaced.
            Some((path.canonicalize().ok()?, path.to_owned(), "an input"))
        };
        Self { taken: inputs.into_iter().filter_map(place).collect() }
    }

    /// One more file that the job reads.
    pub fn protect(&mut self, path: &Path) {
        self.taken.extend(Self::of_inputs([path]).taken);
    }

    /// Prepares to write a file.
    ///
    /// # Errors
    /// [`Error::Output`] if `path` is an input or another output, if a file of another kind
    /// is there, or if the program chose the name and a file is there that `nst` did not
    /// write; [`Error::Io`] as for [`OutputFile::create`].
    pub fn open(&mut self, path: &Path, kind: Kind, name: Name) -> Result<OutputFile, Error> {
        let output = OutputFile::create(path)?;
        let place = output.place();
        if let Some((_, other, what)) = self.taken.iter().find(|(taken, ..)| *taken == place) {
            let message = match other == path {
                true => format!("it is {what} too; give another name"),
                false => format!("it is {what} too, as '{}'; give another name", other.display()),
            };
            return Err(Error::output(path, message));
        }
        kind.check(path, name)?;
        self.taken.push((place, path.to_owned(), "an output"));
        Ok(output)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_and_other_outputs_are_not_replaced() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let [input, output] = ["a.csv", "b.csv"].map(|name| folder.path().join(name));
        std::fs::write(&input, "a,b\n")?;
        let mut outputs = Outputs::of_inputs([&input, &folder.path().join("missing")]);
        let again = folder.path().join(".").join("a.csv");
        for path in [&input, &again] {
            let error = outputs.open(path, Kind::Csv, Name::Given).expect_err("an input");
            assert!(error.to_string().contains("an input"), "{error}");
        }
        let first = outputs.open(&output, Kind::Csv, Name::Given)?;
        let again = folder.path().join(".").join("b.csv");
        let error = outputs.open(&again, Kind::Csv, Name::Given).expect_err("the same file");
        assert!(error.to_string().contains("an output"), "{error}");
        first.commit()?;
        assert!(output.is_file());
        Ok(())
    }
}
