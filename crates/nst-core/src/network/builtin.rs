//! The networks inside the crate.

use super::{file::Weights, guard::GuardNetwork, model::Network, samples::SampleNetwork};
use crate::Error;

/// The names of networks, and their files in `weights/`.
macro_rules! builtin {
    ($($name:literal),* $(,)?) => {
        [$(($name, include_bytes!(concat!("../../weights/", $name, ".safetensors")).as_slice())),*]
    };
}

/// The networks inside the crate: a name and the bytes of the file.
const BUILTIN: &[(&str, &[u8])] = &builtin!(
    "cornell",
    "families",
    "gaussian",
    "step",
    "gaussian-step",
    "plane-lambert",
    "plane-lambert-halton",
    "plane-ggx",
    "plane-ggx-halton",
    "teapot-diffuse",
    "teapot-diffuse-halton",
    "teapot-glossy",
    "teapot-glossy-halton",
    "cornell-direct",
    "cornell-direct-halton",
    "cornell-depth-8",
    "cornell-depth-8-halton",
);

/// Those that see samples.
const OF_SAMPLES: &[(&str, &[u8])] = &builtin!(
    "families-samples",
    "gaussian-samples",
    "step-samples",
    "gaussian-step-samples",
    "nano",
    "small",
    "base",
);

/// The one that weighs the guard's experts.
const OF_GUARD: (&str, &[u8]) = builtin!("guard")[0];

/// A network inside the crate, whose file has not been read yet.
#[derive(Clone, Copy, Debug)]
pub struct Builtin {
    name: &'static str,
    file: &'static [u8],
}

impl Builtin {
    /// Its name, as [`Network::builtin`] takes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.name
    }

    /// The bytes of its weights file.
    #[must_use]
    pub fn file(self) -> &'static [u8] {
        self.file
    }

    /// Reads the network from its file.
    ///
    /// # Errors
    /// [`Error::Weights`] if this version of the crate cannot read its own file: a test
    /// makes sure that it can.
    pub fn network(self) -> Result<Network, Error> {
        Network::from_bytes(self.file)
    }
}

impl Network {
    /// The networks inside the crate that read a window of terms, in a fixed order.
    pub fn builtins() -> impl ExactSizeIterator<Item = Builtin> + Clone {
        BUILTIN.iter().map(|&(name, file)| Builtin { name, file })
    }

    /// A network inside the crate, by its name.
    #[must_use]
    pub fn builtin(name: &str) -> Option<Result<Self, Error>> {
        Self::builtins().find(|builtin| builtin.name == name).map(Builtin::network)
    }

    /// The networks inside the crate that were trained on the scene with this fingerprint,
    /// with their names, in the order of [`Self::builtins`].
    ///
    /// # Errors
    /// As for [`Builtin::network`].
    pub fn builtins_trained_on(fingerprint: &str) -> Result<Vec<(&'static str, Self)>, Error> {
        let networks = Self::builtins().map(|builtin| Ok((builtin.name, builtin.network()?)));
        let trained_on_it =
            |(_, network): &(_, Self)| network.metadata().trained_on_scene(fingerprint);
        networks.filter(|network| network.as_ref().map_or(true, trained_on_it)).collect()
    }
}

impl SampleNetwork {
    /// The names of the networks inside the crate that see samples, in a fixed order.
    pub fn builtins() -> impl ExactSizeIterator<Item = &'static str> + Clone {
        OF_SAMPLES.iter().map(|&(name, _)| name)
    }

    /// One of them, by its name.
    #[must_use]
    pub fn builtin(name: &str) -> Option<Result<Self, Error>> {
        OF_SAMPLES.iter().find(|(known, _)| *known == name).map(|(_, file)| Self::from_bytes(file))
    }
}

impl GuardNetwork {
    /// What the network inside the crate is called.
    pub const BUILTIN: &str = OF_GUARD.0;

    /// The network inside the crate, for the experts `lane`, `filter` and `oidn`.
    ///
    /// # Errors
    /// As for [`Builtin::network`].
    pub fn builtin() -> Result<Self, Error> {
        Self::from_bytes(OF_GUARD.1)
    }
}

impl Weights {
    /// A network inside the crate, of any kind, by its name.
    #[must_use]
    pub fn builtin(name: &str) -> Option<Result<Self, Error>> {
        let all = BUILTIN.iter().chain(OF_SAMPLES).chain([&OF_GUARD]);
        let found = all.into_iter().find(|(known, _)| *known == name);
        found.map(|(_, file)| Self::from_bytes(file))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_are_readable_and_have_names_of_their_own() -> Result<(), Error> {
        for builtin in Network::builtins() {
            let network = Network::builtin(builtin.name()).expect("it is in the list")?;
            assert_eq!(network, builtin.network()?, "{}", builtin.name());
        }
        assert!(Network::builtin("nothing").is_none());
        for name in SampleNetwork::builtins() {
            let network = SampleNetwork::builtin(name).expect("it is in the list")?;
            let samples = if name.ends_with("-samples") { (4, 64) } else { (2, 256) };
            assert_eq!(network.metadata().samples, samples, "{name}");
            let weights = Weights::builtin(name).expect("it is in the list")?;
            assert!(matches!(weights, Weights::Samples(it) if it == network), "{name}");
            assert!(Network::builtins().all(|builtin| builtin.name() != name));
        }
        let guard = GuardNetwork::builtin()?;
        assert_eq!(guard.experts(), ["lane", "filter", "oidn"]);
        let weights = Weights::builtin(GuardNetwork::BUILTIN).expect("it has a name")?;
        assert!(matches!(weights, Weights::Guard(it) if it == guard));
        assert!(SampleNetwork::builtin("step").is_none() && Weights::builtin("steps").is_none());
        assert!(matches!(Weights::builtin("step"), Some(Ok(Weights::Window(_)))));
        Ok(())
    }

    #[test]
    fn a_scene_finds_its_networks() -> Result<(), Error> {
        let cornell = Network::builtin("cornell").expect("it is in the list")?;
        let scene = cornell.metadata().trained_on.iter().find_map(|it| it.strip_prefix("scene:"));
        let scene = scene.expect("it was trained on a scene");
        let found = Network::builtins_trained_on(scene)?;
        assert_eq!(found, [("cornell", cornell.clone())]);
        // Part of a fingerprint is another scene's.
        for other in ["", &scene[1..], &scene[..scene.len() - 1], "step"] {
            assert!(Network::builtins_trained_on(other)?.is_empty(), "{other}");
        }
        Ok(())
    }
}
