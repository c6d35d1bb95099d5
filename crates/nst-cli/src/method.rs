//! Which transformation a command line stands for, and on what it runs.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use nst_core::{
    BUILTIN, Error as CoreError, Identity, MlpCpu, Network, Transform,
    gpu::{AdapterKind, Gpu, MlpGpu},
    methods::method,
};

use crate::{
    args::{BackendArg, MethodArgs, TransformArg},
    error::Error,
    fallback::{self, Fallback},
};

/// Terms that a rendering keeps where no network asks for a number.
pub(crate) const DEFAULT_WINDOW: usize = 8;

const AS_ASKED: &str = "as asked";

/// A transformation, ready to be applied.
pub(crate) struct Method {
    /// `none`, the name of a built-in network or method, or a weights file.
    pub(crate) name: String,
    /// Why it was chosen, in words for the summary.
    pub(crate) reason: String,
    /// The GPU's name.
    pub(crate) adapter: Option<String>,
    /// Whether the CPU has taken over from the GPU.
    pub(crate) gpu_failed: Arc<AtomicBool>,
    pub(crate) transform: Box<dyn Transform>,
}

impl Method {
    /// Resolves the options for a sequence of a scene. `counts` are the samples behind
    /// its terms; the last alone stands for consecutive ones.
    pub(crate) fn resolve(args: &MethodArgs, scene: &str, counts: &[u32]) -> Result<Self, Error> {
        match &args.weights {
            Some(path) => {
                let network = Network::read(path)
                    .map_err(|source| Error::Weights { path: path.clone(), source })?;
                Self::network(path.display().to_string(), AS_ASKED, network, args.backend)
            }
            None => Self::named(args.transform, args.backend, scene, counts),
        }
    }

    /// Resolves a method by name, as [`Self::resolve`] does.
    pub(crate) fn named(
        transform: TransformArg,
        backend: BackendArg,
        scene: &str,
        counts: &[u32],
    ) -> Result<Self, Error> {
        match transform {
            TransformArg::None => Ok(Self::none(AS_ASKED)),
            TransformArg::Method(name) => {
                let method = method(name);
                let method =
                    method.unwrap_or_else(|| unreachable!("the command line admits known names"));
                Ok(Self::on_cpu(name, AS_ASKED, method))
            }
            TransformArg::Builtin(name) => Self::network(name, AS_ASKED, builtin(name)?, backend),
            TransformArg::Auto => match trained_on(scene, counts)? {
                Ok((name, network)) => {
                    let reason = format!("trained on this scene; {}", network.shape());
                    Self::network(name, reason, network, backend)
                }
                Err(reason) => Ok(Self::none(reason)),
            },
        }
    }

    /// Fails if fewer terms are at hand than the method reads; `advice` says what to do then.
    pub(crate) fn check_terms(&self, terms: usize, advice: &str) -> Result<(), Error> {
        let window = self.transform.window();
        if terms < window {
            return Err(Error::Usage(format!(
                "'{}' reads the last {window} terms of a sequence, but there are {terms}; {advice}",
                self.name
            )));
        }
        Ok(())
    }

    /// The GPU that the transformation ran on, if it did not fail.
    pub(crate) fn adapter(&self) -> Option<&str> {
        let failed = self.gpu_failed.load(Ordering::Relaxed);
        self.adapter.as_deref().filter(|_| !failed)
    }

    /// `cpu` or `gpu`.
    pub(crate) fn backend(&self) -> &'static str {
        if self.adapter().is_some() { "gpu" } else { "cpu" }
    }

    fn none(reason: impl Into<String>) -> Self {
        Self::on_cpu("none", reason, Box::new(Identity))
    }

    fn on_cpu(name: &str, reason: impl Into<String>, transform: Box<dyn Transform>) -> Self {
        Self {
            name: name.to_owned(),
            reason: reason.into(),
            adapter: None,
            gpu_failed: Arc::default(),
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
        let on_gpu = |kind| {
            let gpu = Gpu::open(kind)?;
            let adapter = gpu.name().to_owned();
            MlpGpu::new(gpu, Arc::clone(&network)).map(|mlp| (adapter, mlp))
        };
        let cpu = MlpCpu::new(Arc::clone(&network));
        let gpu_failed = Arc::default();
        let (adapter, transform): (_, Box<dyn Transform>) = match backend {
            BackendArg::Cpu => (None, Box::new(cpu)),
            BackendArg::Gpu => {
                let (adapter, mlp) = on_gpu(AdapterKind::Any).map_err(Error::Gpu)?;
                (Some(adapter), Box::new(mlp))
            }
            BackendArg::Auto => match on_gpu(AdapterKind::Hardware) {
                Ok((adapter, mlp)) => {
                    (Some(adapter), Box::new(Fallback::new(mlp, cpu, Arc::clone(&gpu_failed))))
                }
                // A machine without a GPU is nothing to warn of.
                Err(CoreError::NoAdapter(_)) => (None, Box::new(cpu)),
                Err(error) => {
                    fallback::warn(&error);
                    (None, Box::new(cpu))
                }
            },
        };
        Ok(Self { name: name.into(), reason: reason.into(), adapter, gpu_failed, transform })
    }
}

fn builtin(name: &str) -> Result<Network, Error> {
    let network = Network::builtin(name);
    Ok(network.unwrap_or_else(|| unreachable!("the command line admits built-in names only"))?)
}

/// The built-in network for this very scene and these terms, or why there is none.
fn trained_on(
    scene: &str,
    counts: &[u32],
) -> Result<Result<(&'static str, Network), String>, Error> {
    let wanted = format!("scene:{scene}");
    for (name, _) in BUILTIN {
        let network = builtin(name)?;
        let metadata = network.metadata();
        if metadata.trained_on.contains(&wanted) {
            let (first, last) = metadata.samples;
            let window = &counts[counts.len().saturating_sub(metadata.window)..];
            return Ok(if !counts.last().is_some_and(|spp| (first..=last).contains(spp)) {
                Err(format!("network '{name}' was trained on {first} to {last} spp of this scene"))
            } else if window.windows(2).any(|pair| pair[1] - pair[0] > 1) {
                // As in merged sequences: they vary more than what it has seen.
                Err(format!("network '{name}' was trained on terms that are one sample apart"))
            } else {
                Ok((name, network))
            });
        }
    }
    Ok(Err("no network was trained on this very scene".to_owned()))
}
