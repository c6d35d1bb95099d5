//! `nst completions` and `nst man`: the command line, for shells and for readers of manuals.

use std::fmt;

use clap::CommandFactory;
use serde::Serialize;

use crate::{
    args::{Args, CompletionsArgs, ManArgs},
    error::Error,
};

/// A text that is printed as it is.
#[derive(Serialize)]
pub(super) struct Text {
    text: String,
}

pub(super) fn completions(args: &CompletionsArgs) -> Result<Text, Error> {
    let mut text = Vec::new();
    clap_complete::generate(args.shell, &mut Args::command(), "nst", &mut text);
    Ok(Text { text: String::from_utf8_lossy(&text).into_owned() })
}

pub(super) fn manual(args: &ManArgs) -> Result<Text, Error> {
    let mut program = Args::command();
    // Subcommands inherit what they need to name themselves, `nst render` for instance.
    program.build();
    let command = match &args.command {
        None => program,
        Some(name) => {
            let found = program.find_subcommand(name).cloned();
            let names: Vec<_> = program.get_subcommands().map(|c| c.get_name()).collect();
            found.ok_or_else(|| {
                Error::Usage(format!(
                    "there is no command '{name}'; there are {}",
                    names.join(", ")
                ))
            })?
        }
    };
    let mut text = Vec::new();
    clap_mangen::Man::new(command).render(&mut text).map_err(Error::Stdout)?;
    Ok(Text { text: String::from_utf8_lossy(&text).into_owned() })
}

impl fmt::Display for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.text.trim_end())
    }
}
