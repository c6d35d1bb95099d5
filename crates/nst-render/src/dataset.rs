//! Many independent runs of one scene in one file, for training: safetensors
//! with a single tensor `sequences` of f32 `[run][term][lane]`, written run by
//! run and meant to be memory-mapped.

use std::io::{BufWriter, Seek, SeekFrom, Write};

use nst_core::SequenceBatch;
use serde_json::json;

use crate::{Error, output::OutputFile};

/// What the file says about its runs, all of it in the safetensors metadata.
#[derive(Clone, Debug)]
pub struct DatasetInfo {
    /// Width and height in pixels; there are three planar channels of lanes.
    pub size: [u32; 2],
    /// The number of runs.
    pub runs: u32,
    /// Terms per run: S_1 … S_N.
    pub terms: u32,
    /// The scene's fingerprint.
    pub scene: String,
    /// The sampler's name.
    pub sampler: String,
    /// The seed of run 0; the others follow.
    pub first_seed: u64,
}

/// Writes a dataset.
#[derive(Debug)]
pub struct DatasetWriter {
    output: OutputFile,
    info: DatasetInfo,
    written: u32,
}

impl DatasetWriter {
    /// Writes the header.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be written.
    pub fn new(mut output: OutputFile, info: DatasetInfo) -> Result<Self, Error> {
        let header = header(&info, info.runs, 0);
        let length = (header.len() as u64).to_le_bytes();
        let result =
            output.file().write_all(&length).and_then(|()| output.file().write_all(&header));
        result.map_err(|error| Error::io("write", output.path(), error))?;
        Ok(Self { output, info, written: 0 })
    }

    /// Appends a run.
    ///
    /// # Errors
    /// [`Error::Settings`] if its shape is not that of the header or if there are
    /// too many, [`Error::Io`] if it cannot be written.
    pub fn push(&mut self, run: &SequenceBatch) -> Result<(), Error> {
        let lanes = 3 * self.info.size[0] as usize * self.info.size[1] as usize;
        let shape = (self.info.terms as usize, lanes);
        if run.terms().dim() != shape || self.written == self.info.runs {
            return Err(Error::Settings(format!(
                "run {} of {} has the shape {:?}, not {shape:?}",
                self.written,
                self.info.runs,
                run.terms().dim()
            )));
        }
        let mut buffer = BufWriter::new(self.output.file());
        let write = |value: &f32| buffer.write_all(&value.to_le_bytes());
        let result = run.terms().iter().try_for_each(write).and_then(|()| buffer.flush());
        drop(buffer);
        result.map_err(|error| Error::io("write", self.output.path(), error))?;
        self.written += 1;
        Ok(())
    }

    /// Puts the finished file in its place; it may have fewer runs than were planned.
    ///
    /// # Errors
    /// [`Error::Settings`] if there are no runs, [`Error::Io`] if it cannot be renamed.
    pub fn finish(mut self) -> Result<(), Error> {
        if self.written == 0 {
            return Err(Error::Settings("no run was written".into()));
        }
        if self.written < self.info.runs {
            let planned = header(&self.info, self.info.runs, 0).len();
            let header = header(&self.info, self.written, planned);
            let file = self.output.file();
            let result = file.seek(SeekFrom::Start(8)).and_then(|_| file.write_all(&header));
            result.map_err(|error| Error::io("write", self.output.path(), error))?;
        }
        self.output.commit()
    }
}

/// The JSON header, `length` bytes long or as long as it needs to be.
fn header(info: &DatasetInfo, runs: u32, length: usize) -> Vec<u8> {
    let lanes = 3 * u64::from(info.size[0]) * u64::from(info.size[1]);
    let bytes = 4 * u64::from(runs) * u64::from(info.terms) * lanes;
    let header = json!({
        "__metadata__": {
            "format": "nst-dataset-1",
            "width": info.size[0].to_string(),
            "height": info.size[1].to_string(),
            "scene": info.scene,
            "sampler": info.sampler,
            "first_seed": info.first_seed.to_string(),
        },
        "sequences": {
            "dtype": "F32",
            "shape": [u64::from(runs), u64::from(info.terms), lanes],
            "data_offsets": [0, bytes],
        },
    });
    let mut header = header.to_string().into_bytes();
    // Spaces up to a multiple of eight keep the numbers aligned in memory.
    header.resize(length.max(header.len().next_multiple_of(8)), b' ');
    header
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;
    use safetensors::SafeTensors;

    use super::*;

    #[test]
    fn fewer_runs_than_planned_are_a_sound_dataset() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("x.safetensors");
        let info = DatasetInfo {
            size: [1, 1],
            runs: 1_000_000,
            terms: 2,
            scene: "s".into(),
            sampler: "random".into(),
            first_seed: 7,
        };
        let run = SequenceBatch::new(Array2::ones((2, 3)), vec![1, 2])?;
        assert!(DatasetWriter::new(OutputFile::create(&path)?, info.clone())?.finish().is_err());
        let mut writer = DatasetWriter::new(OutputFile::create(&path)?, info)?;
        writer.push(&run)?;
        writer.push(&run)?;
        writer.finish()?;
        let bytes = std::fs::read(&path)?;
        let tensors = SafeTensors::deserialize(&bytes)?;
        assert_eq!(tensors.tensor("sequences")?.shape(), [2, 2, 3]);
        Ok(())
    }
}
