//! Many independent runs of one scene in one file, for training: safetensors
//! with a single tensor `sequences` of f32 `[run][term][lane]`, written run by
//! run and meant to be memory-mapped.

use std::{
    fs::File,
    io::{BufWriter, Read, Seek, SeekFrom, Write},
    path::Path,
    str::FromStr,
};

use nst_core::SequenceBatch;
use safetensors::tensor::Metadata;
use serde_json::json;

use crate::{Error, output_file::OutputFile};

/// The value of the metadata key `format`.
pub const FORMAT: &str = "nst-dataset-1";

/// The most bytes of a header: the limit of safetensors' own reader.
const MOST_HEADER: u64 = 100_000_000;

/// What the file says about its runs, in the safetensors metadata and the shape.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetInfo {
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// How many planar channels of lanes there are: 3 or 1.
    pub channels: u32,
    /// The number of runs.
    pub runs: u32,
    /// The number of samples behind each term of a run.
    pub sample_counts: Vec<u32>,
    /// The scene's fingerprint.
    pub scene: String,
    /// The sampler's name.
    pub sampler: String,
    /// The seed of run 0, if those of the others count up from it.
    pub first_seed: Option<u64>,
}

impl DatasetInfo {
    fn lanes(&self) -> u64 {
        u64::from(self.channels) * u64::from(self.size[0]) * u64::from(self.size[1])
    }

    /// Reads the header of a dataset.
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong with it.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let header = Header::read(path)?;
        if header.text("format")? != FORMAT {
            let message =
                format!("it is not a dataset: its format is '{}'", header.text("format")?);
            return Err(Error::malformed(path, message));
        }
        let size = [header.number("width")?, header.number("height")?];
        let tensor = header.metadata.info("sequences");
        let Some(&[runs, terms, lanes]) = tensor.map(|tensor| tensor.shape.as_slice()) else {
            return Err(Error::malformed(path, "no tensor 'sequences' of [run, term, lane]"));
        };
        let sample_counts = header.sample_counts(terms)?;
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let bytes = [4, runs, terms, lanes]
            .into_iter()
            .try_fold(1_u64, |product, factor| product.checked_mul(factor as u64));
        let consistent = sample_counts.len() == terms
            && [pixels, 3 * pixels].contains(&(lanes as u64))
            && bytes == Some(header.data_bytes);
        if !consistent {
            let message = format!(
                "damaged: [{runs}, {terms}, {lanes}] numbers for {} terms of {}x{} pixels, in {} \
                 bytes",
                sample_counts.len(),
                size[0],
                size[1],
                header.data_bytes
            );
            return Err(Error::malformed(path, message));
        }
        let too_many = |_| Error::malformed(path, format!("{runs} runs are too many"));
        Ok(Self {
            size,
            channels: if lanes as u64 == pixels { 1 } else { 3 },
            runs: u32::try_from(runs).map_err(too_many)?,
            sample_counts,
            scene: header.text("scene")?.to_owned(),
            sampler: header.text("sampler")?.to_owned(),
            first_seed: match header.optional("first_seed") {
                Some(_) => Some(header.number("first_seed")?),
                None => None,
            },
        })
    }
}

/// The metadata key `format` of any safetensors file; empty without one.
///
/// # Errors
/// [`Error::Io`] or [`Error::Malformed`] names the file and what is wrong with it.
pub fn safetensors_format(path: &Path) -> Result<String, Error> {
    Ok(Header::read(path)?.optional("format").unwrap_or_default().to_owned())
}

/// The header of a safetensors file.
struct Header<'a> {
    path: &'a Path,
    metadata: Metadata,
    /// How many bytes follow the header.
    data_bytes: u64,
}

impl<'a> Header<'a> {
    fn read(path: &'a Path) -> Result<Self, Error> {
        let failed = |error| Error::io("read", path, error);
        let damaged = || Error::malformed(path, "not a safetensors file, or a damaged one");
        let mut file = File::open(path).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        let mut start = [0; 8];
        file.read_exact(&mut start).map_err(|_| damaged())?;
        let header = u64::from_le_bytes(start);
        if header > MOST_HEADER || header > length.saturating_sub(8) {
            return Err(damaged());
        }
        let mut bytes = vec![0; header as usize];
        file.read_exact(&mut bytes).map_err(failed)?;
        let metadata = serde_json::from_slice(&bytes).map_err(|_| damaged())?;
        Ok(Self { path, metadata, data_bytes: length - 8 - header })
    }

    fn optional(&self, key: &str) -> Option<&str> {
        self.metadata.metadata().as_ref()?.get(key).map(String::as_str)
    }

    fn text(&self, key: &str) -> Result<&str, Error> {
        let missing = || Error::malformed(self.path, format!("metadata '{key}' is missing"));
        self.optional(key).ok_or_else(missing)
    }

    fn number<T: FromStr>(&self, key: &str) -> Result<T, Error> {
        self.parse(key, self.text(key)?)
    }

    fn parse<T: FromStr>(&self, key: &str, text: &str) -> Result<T, Error> {
        let message = || format!("metadata '{key}' is '{text}', not a number in range");
        text.parse().map_err(|_| Error::malformed(self.path, message()))
    }

    /// The number of samples behind each term; a file that does not say it stores all
    /// terms.
    fn sample_counts(&self, terms: usize) -> Result<Vec<u32>, Error> {
        match self.optional("sample_counts") {
            Some(counts) => {
                counts.split(',').map(|count| self.parse("sample_counts", count)).collect()
            }
            None => Ok((1..=u32::try_from(terms).unwrap_or(0)).collect()),
        }
    }
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
        let header = header_bytes(&info, info.runs, 0);
        let length = (header.len() as u64).to_le_bytes();
        let result =
            output.file().write_all(&length).and_then(|()| output.file().write_all(&header));
        result.map_err(|error| Error::io("write", output.path(), error))?;
        Ok(Self { output, info, written: 0 })
    }

    /// Appends a run.
    ///
    /// # Errors
    /// [`Error::Mismatch`] if its shape is not that of the header or if there are
    /// too many, [`Error::Io`] if it cannot be written.
    pub fn push(&mut self, run: &SequenceBatch) -> Result<(), Error> {
        let shape = (self.info.sample_counts.len(), self.info.lanes() as usize);
        if run.terms().dim() != shape || self.written == self.info.runs {
            return Err(Error::Mismatch(format!(
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
    /// [`Error::Mismatch`] if there are no runs, [`Error::Io`] if it cannot be renamed.
    pub fn finish(mut self) -> Result<(), Error> {
        if self.written == 0 {
            return Err(Error::Mismatch("no run was written".into()));
        }
        if self.written < self.info.runs {
            let planned = header_bytes(&self.info, self.info.runs, 0).len();
            let header = header_bytes(&self.info, self.written, planned);
            let file = self.output.file();
            let result = file.seek(SeekFrom::Start(8)).and_then(|_| file.write_all(&header));
            result.map_err(|error| Error::io("write", self.output.path(), error))?;
        }
        self.output.commit()
    }
}

/// The JSON header, padded to `length` bytes if it is shorter.
fn header_bytes(info: &DatasetInfo, runs: u32, length: usize) -> Vec<u8> {
    let (lanes, terms) = (info.lanes(), info.sample_counts.len() as u64);
    let bytes = 4 * u64::from(runs) * terms * lanes;
    let counts: Vec<_> = info.sample_counts.iter().map(u32::to_string).collect();
    let mut metadata = json!({
        "format": FORMAT,
        "width": info.size[0].to_string(),
        "height": info.size[1].to_string(),
        "sample_counts": counts.join(","),
        "scene": info.scene,
        "sampler": info.sampler,
    });
    if let Some(seed) = info.first_seed {
        metadata["first_seed"] = seed.to_string().into();
    }
    let header = json!({
        "__metadata__": metadata,
        "sequences": {
            "dtype": "F32",
            "shape": [u64::from(runs), terms, lanes],
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
            channels: 3,
            runs: 1_000_000,
            sample_counts: vec![1, 2],
            scene: "s".into(),
            sampler: "random".into(),
            first_seed: Some(7),
        };
        let run = SequenceBatch::new(Array2::ones((2, 3)), vec![1, 2])?;
        assert!(DatasetWriter::new(OutputFile::create(&path)?, info.clone())?.finish().is_err());
        let mut writer = DatasetWriter::new(OutputFile::create(&path)?, info.clone())?;
        writer.push(&run)?;
        writer.push(&run)?;
        writer.finish()?;
        let bytes = std::fs::read(&path)?;
        let tensors = SafeTensors::deserialize(&bytes)?;
        assert_eq!(tensors.tensor("sequences")?.shape(), [2, 2, 3]);
        assert_eq!(DatasetInfo::read(&path)?, DatasetInfo { runs: 2, ..info });
        std::fs::write(&path, &bytes[..bytes.len() - 1])?;
        assert!(DatasetInfo::read(&path).is_err_and(|e| e.to_string().contains("damaged")));
        let seed = bytes.windows(16).position(|part| part == b"\"first_seed\":\"7\"");
        let mut damaged = bytes;
        damaged[seed.expect("a first seed") + 14] = b'x';
        std::fs::write(&path, damaged)?;
        assert!(DatasetInfo::read(&path).is_err_and(|e| e.to_string().contains("first_seed")));
        Ok(())
    }
}
