//! Networks, by their names or their files.

use std::path::Path;

use nst_core::Network;

use crate::error::Error;

/// The network of a weights file.
pub(crate) fn network_of(path: &Path) -> Result<Network, Error> {
    Network::read(path).map_err(|source| Error::Weights { path: path.to_owned(), source })
}

/// The built-in network of a name.
pub(crate) fn builtin(name: &str) -> Result<Network, Error> {
    let network = Network::builtin(name);
    Ok(network.unwrap_or_else(|| unreachable!("the command line admits built-in names only"))?)
}
