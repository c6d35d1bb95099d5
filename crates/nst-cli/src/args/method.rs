//! Which transformation, and what it runs on.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use clap::{
    ValueEnum,
    builder::{PossibleValue, PossibleValuesParser, TypedValueParser},
};
use nst_core::{GuardNetwork, Network, SampleNetwork, methods::METHODS};

use super::values::has_extension;
use crate::oidn;

#[derive(Debug, clap::Args)]
pub(crate) struct MethodArgs {
    /// What makes better estimates of the plain ones.
    #[arg(long, value_name = "METHOD", default_value = "auto", value_parser = transform())]
    pub(crate) transform: TransformArg,
    /// The experts that `auto` may trust: `lane`, which are three that learn from the picture
    /// itself; `filter` and `oidn` (Open Image Denoise, if it is found), which look at neighbours; and
    /// networks that see the samples, by their names (such as `small`) or their safetensors files.
    /// `all` stands for `lane,filter`, and for `oidn` where it can be loaded: networks have added
    /// nothing to these. [default: lane, and filter, but of large pictures only if it takes no
    /// longer than a third of the rendering]
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = expert, conflicts_with = "weights")]
    pub(crate) experts: Vec<ExpertArg>,
    /// What weighs experts that look at neighbours: `closed`, a formula over samples that were held
    /// out; or `learned`, a network that corrects it where it knows better, or that of a safetensors
    /// file. [default: learned]
    #[arg(long, value_name = "HOW", value_parser = guard, conflicts_with = "weights")]
    pub(crate) guard: Option<GuardArg>,
    /// Use the network of this safetensors file.
    #[arg(long, value_name = "FILE", conflicts_with = "transform")]
    pub(crate) weights: Option<PathBuf>,
    /// What a network or the filter runs on. `auto` leaves networks that see the samples or weigh
    /// experts, and the filter, on the CPU.
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

/// What the guard is called, here and in [`METHODS`].
const AUTO: &str = "auto";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TransformArg {
    /// The guard.
    Auto,
    None,
    /// The name of a network of [`Network::builtins`].
    Builtin(&'static str),
    /// The name of a network of [`SampleNetwork::builtins`].
    Samples(&'static str),
    /// Another name in [`METHODS`].
    Method(&'static str),
}

/// What weighs the guard's experts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum GuardArg {
    /// The closed form.
    Closed,
    /// The built-in network.
    Learned,
    /// The network of a file.
    Weights(PathBuf),
}

impl GuardArg {
    /// The file that it is read from.
    pub(crate) fn file(&self) -> Option<&PathBuf> {
        match self {
            Self::Weights(path) => Some(path),
            Self::Closed | Self::Learned => None,
        }
    }
}

impl fmt::Display for GuardArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Closed => f.write_str(CLOSED),
            Self::Learned => f.write_str(LEARNED),
            Self::Weights(path) => path.display().fmt(f),
        }
    }
}

/// What the guard may blend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum ExpertArg {
    /// The next three, as far as they can run here.
    All,
    /// The guard's own, which learn from the lanes of the batch.
    Lane,
    /// The statistical filter.
    Filter,
    /// Open Image Denoise.
    Oidn,
    /// A built-in network that reads terms.
    Builtin(&'static str),
    /// A built-in network that sees samples.
    Samples(&'static str),
    /// The network of a file.
    Weights(PathBuf),
}

impl ExpertArg {
    /// The file that it is read from.
    pub(crate) fn file(&self) -> Option<&PathBuf> {
        match self {
            Self::Weights(path) => Some(path),
            _ => None,
        }
    }
}

impl fmt::Display for ExpertArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str(ALL),
            Self::Lane => f.write_str(LANE),
            Self::Filter => f.write_str(FILTER),
            Self::Oidn => f.write_str(oidn::NAME),
            Self::Builtin(name) | Self::Samples(name) => f.write_str(name),
            Self::Weights(path) => path.display().fmt(f),
        }
    }
}

impl MethodArgs {
    /// The files that are read for the method.
    pub(crate) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        let of_guard = self.guard.as_ref().and_then(GuardArg::file);
        let experts = self.experts.iter().filter_map(ExpertArg::file);
        self.weights.iter().chain(experts).chain(of_guard)
    }
}

/// What the experts together are called that need no file.
const ALL: &str = "all";

/// What the guard's own experts are called.
const LANE: &str = "lane";

/// What the filter is called, here and in [`METHODS`].
pub(crate) const FILTER: &str = "filter";

/// What a formula is called that weighs experts, and what the built-in network.
pub(crate) const CLOSED: &str = "closed";
pub(crate) const LEARNED: &str = "learned";

/// Takes what weighs experts.
pub(super) fn guard(text: &str) -> Result<GuardArg, String> {
    let path = Path::new(text);
    match text {
        CLOSED => Ok(GuardArg::Closed),
        LEARNED => Ok(GuardArg::Learned),
        _ if has_extension(path, "safetensors") => Ok(GuardArg::Weights(path.to_owned())),
        _ => Err(format!("it is {CLOSED}, {LEARNED}, or FILE.safetensors")),
    }
}

/// Takes the name of an expert.
pub(super) fn expert(text: &str) -> Result<ExpertArg, String> {
    let path = Path::new(text);
    match TransformArg::named(text) {
        _ if text == ALL => Ok(ExpertArg::All),
        _ if text == LANE => Ok(ExpertArg::Lane),
        _ if text == FILTER => Ok(ExpertArg::Filter),
        _ if text == oidn::NAME => Ok(ExpertArg::Oidn),
        Some(TransformArg::Builtin(name)) => Ok(ExpertArg::Builtin(name)),
        Some(TransformArg::Samples(name)) => Ok(ExpertArg::Samples(name)),
        _ if has_extension(path, "safetensors") => Ok(ExpertArg::Weights(path.to_owned())),
        _ => {
            let networks: Vec<_> = SampleNetwork::builtins().collect();
            Err(format!(
                "there is no expert '{text}'; there are {LANE}, which are the guard's own, {FILTER}, \
                 {}, {ALL} of these, {}, or FILE.safetensors",
                oidn::NAME,
                networks.join(", ")
            ))
        }
    }
}

impl TransformArg {
    /// What the command line calls it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => AUTO,
            Self::None => "none",
            Self::Builtin(name) | Self::Samples(name) | Self::Method(name) => name,
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

/// Takes the name of a built-in network of any kind.
pub(super) fn builtin_name() -> PossibleValuesParser {
    let names = Network::builtins().map(|it| it.name());
    PossibleValuesParser::new(names.chain(SampleNetwork::builtins()).chain([GuardNetwork::BUILTIN]))
}

/// The methods that have names, and what each is in a few words.
fn known() -> impl Iterator<Item = (&'static str, &'static str, TransformArg)> {
    let builtin = Network::builtins().map(|it| it.name());
    let builtin = builtin.map(|name| (name, "a built-in network", TransformArg::Builtin(name)));
    let of_samples = SampleNetwork::builtins();
    let of_samples = of_samples.map(|name| {
        (name, "a built-in network that sees the samples", TransformArg::Samples(name))
    });
    let methods = METHODS.iter().map(|&(name, about)| {
        let arg = if name == AUTO { TransformArg::Auto } else { TransformArg::Method(name) };
        (name, about, arg)
    });
    let (auto, methods): (Vec<_>, Vec<_>) = methods.partition(|it| it.2 == TransformArg::Auto);
    let none = ("none", "the plain estimates", TransformArg::None);
    auto.into_iter().chain([none]).chain(builtin).chain(of_samples).chain(methods)
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
        assert_eq!(parsed("small"), Ok(TransformArg::Samples("small")));
        assert_eq!(parsed("levin-u"), Ok(TransformArg::Method("levin-u")));
        assert_eq!(parsed("auto"), Ok(TransformArg::Auto));
        assert!(parsed("Cornell").is_err_and(|error| error.contains("families")));
        assert!(parsed("guard").is_err());
        let mut names: Vec<_> = known().map(|it| it.0).collect();
        assert_eq!(names[..2], ["auto", "none"]);
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count, "a name stands for one method");
    }
}
