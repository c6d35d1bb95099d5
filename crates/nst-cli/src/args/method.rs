//! Which transformation, and what it runs on.

use std::path::PathBuf;

use clap::{
    ValueEnum,
    builder::{PossibleValue, PossibleValuesParser, TypedValueParser},
};
use nst_core::{Network, methods::METHODS};

#[derive(Debug, clap::Args)]
pub(crate) struct MethodArgs {
    /// What makes better estimates of the plain ones.
    #[arg(long, value_name = "METHOD", default_value = "auto", value_parser = transform())]
    pub(crate) transform: TransformArg,
    /// Use the network of this safetensors file.
    #[arg(long, value_name = "FILE", conflicts_with = "transform")]
    pub(crate) weights: Option<PathBuf>,
    /// What the network runs on.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) backend: BackendArg,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum BackendArg {
    /// A hardware GPU if there is one, else the CPU.
    #[default]
    Auto,
    /// The first GPU, or a software adapter if there is no GPU.
    Gpu,
    /// The CPU.
    Cpu,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TransformArg {
    Auto,
    None,
    /// The name of a network of [`Network::builtins`].
    Builtin(&'static str),
    /// A name in [`METHODS`].
    Method(&'static str),
}

impl TransformArg {
    /// What the command line calls it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::None => "none",
            Self::Builtin(name) | Self::Method(name) => name,
        }
    }

    /// The one that the command line calls so.
    pub(crate) fn named(name: &str) -> Option<Self> {
        known().find(|(known, ..)| *known == name).map(|(.., arg)| arg)
    }

    /// All of them, `auto` first.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        known().map(|(.., arg)| arg)
    }
}

/// Takes the name of a method; the help lists all of them.
pub(super) fn transform() -> impl TypedValueParser<Value = TransformArg> {
    let names = known().map(|(name, about, _)| PossibleValue::new(name).help(about));
    PossibleValuesParser::new(names).map(|text| {
        let found = TransformArg::named(&text);
        found.unwrap_or_else(|| unreachable!("clap admits known names only"))
    })
}

/// The methods that have names, and what each is in a few words.
fn known() -> impl Iterator<Item = (&'static str, &'static str, TransformArg)> {
    let builtin = Network::builtins().map(|it| it.name());
    let builtin = builtin.map(|name| (name, "a built-in network", TransformArg::Builtin(name)));
    let methods = METHODS.iter().map(|&(name, about)| (name, about, TransformArg::Method(name)));
    let auto = "the built-in network that was trained on exactly this scene, or else none";
    [("auto", auto, TransformArg::Auto), ("none", "the plain estimates", TransformArg::None)]
        .into_iter()
        .chain(builtin)
        .chain(methods)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Only {
        #[command(flatten)]
        method: MethodArgs,
    }

    #[test]
    fn networks_and_methods_have_names() {
        let parsed = |name| {
            let args = Only::try_parse_from(["nst", "--transform", name]);
            args.map(|args| args.method.transform).map_err(|error| error.to_string())
        };
        assert_eq!(parsed("cornell"), Ok(TransformArg::Builtin("cornell")));
        assert_eq!(parsed("levin-u"), Ok(TransformArg::Method("levin-u")));
        assert!(parsed("Cornell").is_err_and(|error| error.contains("families")));
    }
}
