//! The program and the machine, for reports of errors.

use std::fmt;

use serde::Serialize;

use crate::{system, words::counted};

/// What decides how the program runs here.
#[derive(Serialize)]
#[serde(tag = "kind", rename = "system")]
pub(super) struct SystemInfo {
    version: &'static str,
    build: String,
    system: String,
    processor: String,
    threads: usize,
    instructions: &'static str,
    adapters: Vec<String>,
    denoiser: Denoiser,
}

/// The library of Open Image Denoise that would be loaded first.
#[derive(Default, Serialize)]
struct Denoiser {
    /// Its file, and where it was found.
    file: Option<String>,
    /// Where the names of its files say it.
    version: Option<String>,
    /// Why none can be found.
    error: Option<String>,
}

impl Denoiser {
    /// Searches, and loads nothing.
    fn find() -> Self {
        match nst_oidn::candidates() {
            Err(error) => Self { error: Some(error.to_string()), ..Self::default() },
            Ok(candidates) => Self {
                file: candidates.first().map(ToString::to_string),
                version: candidates.first().and_then(|it| it.version()).map(|it| it.to_string()),
                error: None,
            },
        }
    }
}

impl fmt::Display for Denoiser {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = "Open Image Denoise";
        match (&self.file, &self.version, &self.error) {
            (_, _, Some(error)) => write!(f, "none: {error}"),
            (None, ..) => write!(f, "none: --experts oidn needs {name} 2"),
            (Some(file), Some(version), _) => write!(f, "{name} {version}, {file}"),
            (Some(file), None, _) => write!(f, "{name}, {file}"),
        }
    }
}

impl SystemInfo {
    pub(super) fn read() -> Self {
        let profile = if cfg!(debug_assertions) { "debug" } else { "release" };
        Self {
            version: system::VERSION,
            build: format!("{profile}, features {}", system::features().join(" and ")),
            system: format!("{} on {}", std::env::consts::OS, std::env::consts::ARCH),
            processor: system::processor(),
            threads: rayon::current_num_threads(),
            instructions: system::instructions(),
            adapters: system::adapters(),
            denoiser: Denoiser::find(),
        }
    }
}

impl fmt::Display for SystemInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "nst          {} ({})", self.version, self.build)?;
        writeln!(f, "system       {}", self.system)?;
        let threads = counted(self.threads, "thread");
        writeln!(f, "processor    {}, {threads}, {}", self.processor, self.instructions)?;
        if self.adapters.is_empty() {
            writeln!(f, "adapters     none: networks run on the processor")?;
        }
        self.adapters.iter().try_for_each(|adapter| writeln!(f, "adapter      {adapter}"))?;
        writeln!(f, "denoiser     {}", self.denoiser)
    }
}
