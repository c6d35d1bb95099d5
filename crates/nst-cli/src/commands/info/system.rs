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
        self.adapters.iter().try_for_each(|adapter| writeln!(f, "adapter      {adapter}"))
    }
}
