//! Which transformation the command line asks for, and what it runs on.

use std::{path::Path, sync::Arc};

#[cfg(feature = "gpu")]
use nst_core::gpu::{AdapterKind, Gpu, MlpGpu};
use nst_core::{
    Estimates, Identity, MlpCpu, Network, SequenceBatch, Transform, Whole, guard::Judgement,
    methods::method,
};

#[cfg(feature = "gpu")]
use crate::fallback::Fallback;
use crate::{
    adapter::{Adapter, caught},
    args::{BackendArg, MethodArgs, TransformArg},
    error::Error,
};

/// The last terms that a rendering keeps if the method reads no more: the window of the
/// built-in networks.
pub(crate) const DEFAULT_WINDOW: usize = 8;

/// The reason if the command line names the method.
const AS_ASKED: &str = "as asked";

/// What `--transform auto` knows of a sequence when it chooses.
#[derive(Clone, Copy, Default)]
pub(crate) struct Origin<'a> {
    /// The scene's fingerprint.
    pub(crate) scene: &'a str,
    /// The sampler's name; empty where it is not known.
    pub(crate) sampler: &'a str,
    /// The samples behind the terms. The last one alone means terms that are one sample
    /// apart.
    pub(crate) counts: &'a [u32],
}

/// The reason if there is no network for the scene.
const NOT_TRAINED: &str = "no network was trained on this very scene";

/// The method that holds folds out.
const GUARD: &str = "guard";

/// The sampler whose folds are parts of one sequence, so that none says anything about the
/// error of the others.
const NESTED: &str = "halton";

/// What is said then.
const NESTED_FOLDS: &str = "keeps the plain estimates: the folds of --sampler halton depend on \
                            each other; those of halton-folds do not";

/// The sampler of networks whose files name none: the first ones were all trained on
/// `random`.
const FIRST_SAMPLER: &str = "random";

/// A transformation, ready to be applied.
pub(crate) struct Method {
    /// `none`, the name of a built-in network or method, or a weights file.
    pub(crate) name: String,
    /// Why it was chosen, in words for the summary.
    pub(crate) reason: String,
    /// The GPU that is in use.
    pub(crate) adapter: Adapter,
    pub(crate) transform: Box<dyn Transform>,
}

impl Method {
    /// The method that the options ask for.
    pub(crate) fn resolve(args: &MethodArgs, origin: Origin<'_>) -> Result<Self, Error> {
        match &args.weights {
            Some(path) => Self::of_file(path, args.backend),
            None => Self::named(args.transform, args.backend, origin),
        }
    }

    /// The network of a weights file.
    pub(crate) fn of_file(path: &Path, backend: BackendArg) -> Result<Self, Error> {
        let network = Network::read(path)
            .map_err(|source| Error::Weights { path: path.to_owned(), source })?;
        Self::network(path.display().to_string(), AS_ASKED, network, backend)
    }

    /// The method of a name.
    pub(crate) fn named(
        transform: TransformArg,
        backend: BackendArg,
        origin: Origin<'_>,
    ) -> Result<Self, Error> {
        match transform {
            TransformArg::None => Ok(Self::none(AS_ASKED)),
            TransformArg::Method(GUARD) if origin.sampler == NESTED => {
                Ok(Self { name: GUARD.to_owned(), ..Self::none(NESTED_FOLDS) })
            }
            TransformArg::Method(name) => {
                let method = method(name);
                let method =
                    method.unwrap_or_else(|| unreachable!("the command line admits known names"));
                Ok(Self::on_cpu(name, AS_ASKED, method))
            }
            TransformArg::Builtin(name) => Self::network(name, AS_ASKED, builtin(name)?, backend),
            TransformArg::Auto => match choose(Network::builtins_trained_on(origin.scene)?, origin)
            {
                Ok((name, network)) => {
                    let widths = network.shape().replace('-', ", ");
                    let reason = format!("trained on this scene; its layers are {widths} wide");
                    Self::network(name, reason, network, backend)
                }
                Err(reason) => Ok(Self::none(reason)),
            },
        }
    }

    /// Transforms a batch in memory; what the method says of its own gain, if it measures it.
    pub(crate) fn transform(
        &self,
        batch: &SequenceBatch,
        estimates: &mut Estimates,
    ) -> Result<Option<Judgement>, nst_core::Error> {
        caught(|| {
            let fitted = self.transform.fit(&mut Whole::new(batch))?;
            fitted.apply(batch, estimates)?;
            Ok(fitted.judgement().cloned())
        })
    }

    /// Fails if there are fewer terms than the method reads; `advice` says what to do then.
    pub(crate) fn check_terms(&self, terms: usize, advice: &str) -> Result<(), Error> {
        let window = self.transform.requires().window;
        if terms < window {
            return Err(Error::Usage(format!(
                "'{}' reads the last {window} terms of a sequence, but there are {terms}; {advice}",
                self.name
            )));
        }
        Ok(())
    }

    /// The GPU that the transformation ran on, if it did not fail.
    pub(crate) fn adapter(&self) -> Option<String> {
        self.adapter.name()
    }

    /// `cpu` or `gpu`.
    pub(crate) fn backend(&self) -> &'static str {
        if self.adapter().is_some() { "gpu" } else { "cpu" }
    }

    /// Adds what would make `auto` choose a network: options, and the network's name.
    pub(crate) fn advise(&mut self, advice: impl FnOnce() -> Option<(String, &'static str)>) {
        if self.reason == NOT_TRAINED
            && let Some((options, network)) = advice()
        {
            self.reason += &format!("; with {options}, network '{network}' was");
        }
    }

    fn none(reason: impl Into<String>) -> Self {
        Self::on_cpu("none", reason, Box::new(Identity))
    }

    fn on_cpu(name: &str, reason: impl Into<String>, transform: Box<dyn Transform>) -> Self {
        Self {
            name: name.to_owned(),
            reason: reason.into(),
            adapter: Adapter::default(),
            transform,
        }
    }

    fn network(
        name: impl Into<String>,
        reason: impl Into<String>,
        network: Network,
        backend: BackendArg,
    ) -> Result<Self, Error> {
        let network = Arc::new(network);
        let cpu = MlpCpu::new(Arc::clone(&network));
        let adapter = Adapter::default();
        let transform: Box<dyn Transform> = match backend {
            BackendArg::Cpu => Box::new(cpu),
            BackendArg::Gpu => on_gpu(network, &adapter)?,
            BackendArg::Auto => on_any(network, cpu, &adapter),
        };
        Ok(Self { name: name.into(), reason: reason.into(), adapter, transform })
    }
}

/// Opens a GPU, and a network on it.
#[cfg(feature = "gpu")]
fn open(kind: AdapterKind, network: Arc<Network>) -> Result<(String, MlpGpu), nst_core::Error> {
    let gpu = Gpu::open(kind)?;
    let name = gpu.name().to_owned();
    MlpGpu::new(gpu, network).map(|mlp| (name, mlp))
}

/// A network on a GPU, or an error.
#[cfg(feature = "gpu")]
fn on_gpu(network: Arc<Network>, adapter: &Adapter) -> Result<Box<dyn Transform>, Error> {
    let opening = adapter.opens();
    let opened = caught(|| open(AdapterKind::Any, network));
    drop(opening);
    let (name, mlp) = opened.map_err(Error::Gpu)?;
    adapter.set(Some(name));
    Ok(Box::new(mlp))
}

/// A network on a GPU if there is one, else on the CPU.
#[cfg(feature = "gpu")]
fn on_any(network: Arc<Network>, cpu: MlpCpu, adapter: &Adapter) -> Box<dyn Transform> {
    let open = move || open(AdapterKind::Hardware, network);
    Box::new(Fallback::new(open, cpu, adapter.clone()))
}

#[cfg(not(feature = "gpu"))]
fn on_gpu(_: Arc<Network>, _: &Adapter) -> Result<Box<dyn Transform>, Error> {
    let message = "--backend gpu: this nst was built without the feature 'gpu'";
    Err(Error::Usage(message.into()))
}

#[cfg(not(feature = "gpu"))]
fn on_any(_: Arc<Network>, cpu: MlpCpu, _: &Adapter) -> Box<dyn Transform> {
    Box::new(cpu)
}

fn builtin(name: &str) -> Result<Network, Error> {
    let network = Network::builtin(name);
    Ok(network.unwrap_or_else(|| unreachable!("the command line admits built-in names only"))?)
}

/// Of the networks that were trained on exactly this scene, the one for its sampler and its
/// terms, or why there is none.
fn choose(
    networks: Vec<(&'static str, Network)>,
    Origin { sampler, counts, .. }: Origin<'_>,
) -> Result<(&'static str, Network), String> {
    let mut reason = NOT_TRAINED.to_owned();
    for (name, network) in networks {
        let metadata = network.metadata();
        let (first, last) = metadata.samples;
        let window = &counts[counts.len().saturating_sub(metadata.window)..];
        let used = metadata.sampler.as_deref().unwrap_or(FIRST_SAMPLER);
        reason = if used != sampler {
            format!("network '{name}' was trained on this scene with --sampler {used}")
        } else if !counts.last().is_some_and(|spp| (first..=last).contains(spp)) {
            format!(
                "network '{name}' was trained on {first} to {last} samples per pixel of this scene"
            )
        } else if window.windows(2).any(|pair| pair[1] - pair[0] > 1) {
            // As in merged sequences: their terms vary more than those of its training.
            format!("network '{name}' was trained on terms that are one sample apart")
        } else {
            return Ok((name, network));
        };
    }
    Err(reason)
}

#[cfg(test)]
mod tests {
    use safetensors::{Dtype, serialize, tensor::TensorView};

    use super::*;

    /// A network for 2 to 9 samples of one scene.
    fn weights(sampler: Option<&str>) -> Vec<u8> {
        let zeros = [0; 8];
        let tensor = |shape: &[usize], bytes| {
            TensorView::new(Dtype::F32, shape.to_vec(), bytes).expect("sizes match")
        };
        let tensors = [
            ("layers.0.weight", tensor(&[1, 2], &zeros)),
            ("layers.0.bias", tensor(&[1], &zeros[..4])),
        ];
        let metadata = [
            ("format", "nst-weights-1"),
            ("kind", "mlp"),
            ("inputs", "window"),
            ("window", "2"),
            ("activation", "leaky_relu"),
            ("negative_slope", "0.01"),
            ("trained_on", "scene:box:1"),
            ("samples", "2..9"),
            ("loss", "L2"),
            ("epochs", "1"),
            ("seed", "1"),
            ("config", ""),
        ];
        let metadata = metadata.into_iter().chain(sampler.map(|sampler| ("sampler", sampler)));
        let metadata = metadata.map(|(key, value)| (key.to_owned(), value.to_owned()));
        serialize(tensors, Some(metadata.collect())).expect("a safetensors file")
    }

    #[test]
    fn a_network_is_for_its_scene_sampler_and_terms() -> Result<(), Error> {
        let (old, halton) = (weights(None), weights(Some("halton")));
        let chosen = |scene, sampler, counts| -> Result<Result<&str, String>, Error> {
            let networks = [("old", &old), ("halton", &halton)].into_iter();
            let networks = networks.map(|(name, file)| Ok((name, Network::from_bytes(file)?)));
            let mut networks = networks.collect::<Result<Vec<_>, Error>>()?;
            networks.retain(|(_, network)| network.metadata().trained_on_scene(scene));
            Ok(choose(networks, Origin { scene, sampler, counts }).map(|(name, _)| name))
        };
        assert_eq!(chosen("box:1", "random", &[9])?, Ok("old"));
        assert_eq!(chosen("box:1", "halton", &[8, 9])?, Ok("halton"));
        for (scene, sampler, counts, why) in [
            ("box:2", "random", &[9][..], "this very scene"),
            ("box:1", "", &[9], "with --sampler halton"),
            ("box:1", "halton", &[10], "'halton' was trained on 2 to 9 samples"),
            ("box:1", "halton", &[7, 9], "one sample apart"),
        ] {
            let reason = chosen(scene, sampler, counts)?.expect_err(why);
            assert!(reason.contains(why), "{reason}");
        }
        Ok(())
    }
}
