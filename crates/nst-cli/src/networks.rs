//! Networks, by their names or their files.

use std::path::Path;

use nst_core::{GuardNetwork, Network, SampleNetwork, Weights};

use crate::error::Error;

/// The network of a weights file, of either kind.
pub(crate) fn network_of(path: &Path) -> Result<Weights, Error> {
    Weights::read(path).map_err(|source| Error::Weights { path: path.to_owned(), source })
}

/// The network of a weights file that weighs the guard's experts.
pub(crate) fn guard_network_of(path: &Path) -> Result<GuardNetwork, Error> {
    GuardNetwork::read(path).map_err(|source| Error::Weights { path: path.to_owned(), source })
}

/// The built-in network that weighs the guard's experts.
pub(crate) fn builtin_of_guard() -> Result<GuardNetwork, Error> {
    Ok(GuardNetwork::builtin()?)
}

/// The built-in network of a name that reads terms.
pub(crate) fn builtin(name: &str) -> Result<Network, Error> {
    let network = Network::builtin(name);
    Ok(network.unwrap_or_else(|| unreachable!("the command line admits built-in names only"))?)
}

/// The built-in network of a name that sees samples.
pub(crate) fn builtin_of_samples(name: &str) -> Result<SampleNetwork, Error> {
    let network = SampleNetwork::builtin(name);
    Ok(network.unwrap_or_else(|| unreachable!("the command line admits built-in names only"))?)
}
