//! Which transformation, and what it runs on.

use std::path::PathBuf;

use clap::ValueEnum;
use nst_core::{Network, methods::METHODS};

#[derive(Debug, clap::Args)]
pub(crate) struct MethodArgs {
    /// `auto`, `none`, the name of a built-in network, or of a classical or robust
    /// method. `auto` uses the built-in network that was trained on exactly this scene, or
    /// else none.
    #[arg(long, value_name = "METHOD", default_value = "auto", value_parser = transform)]
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

pub(super) fn transform(text: &str) -> Result<TransformArg, String> {
    let builtin = Network::builtins().map(|it| (it.name(), TransformArg::Builtin(it.name())));
    let methods = METHODS.iter().map(|&name| (name, TransformArg::Method(name)));
    let known = [("auto", TransformArg::Auto), ("none", TransformArg::None)];
    let mut known = known.into_iter().chain(builtin).chain(methods);
    known.clone().find(|&(name, _)| name == text).map(|(_, arg)| arg).ok_or_else(|| {
        let first = known.next().map(|(name, _)| name.to_owned()).unwrap_or_default();
        let names = known.fold(first, |names, (name, _)| names + ", " + name);
        format!("known methods are {names}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn networks_and_methods_have_names() {
        assert_eq!(transform("cornell"), Ok(TransformArg::Builtin("cornell")));
        assert_eq!(transform("levin-u"), Ok(TransformArg::Method("levin-u")));
        assert!(transform("Cornell").is_err_and(|error| error.contains("families")));
    }
}
