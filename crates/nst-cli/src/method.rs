//! Which transformation the command line asks for, and what it runs on.

use std::{path::Path, sync::Arc};

#[cfg(feature = "gpu")]
use nst_core::gpu::{AdapterKind, FilterGpu, Gpu, MlpGpu};
use nst_core::{
    Estimates, Identity, MlpCpu, Network, SequenceBatch, Transform, Whole, guard::Judgement,
    methods::method,
};

#[cfg(feature = "gpu")]
use crate::fallback::Fallback;
use crate::{
    adapter::{Adapter, caught},
    args::{BackendArg, ExpertArg, MethodArgs, TransformArg},
    error::Error,
    guard::guard,
    networks::{builtin, network_of},
};

/// The last terms of a stored sequence, unless the method reads more: the window of the
/// built-in networks.
pub(crate) const DEFAULT_WINDOW: usize = 8;

/// The reason if the command line names the method.
const AS_ASKED: &str = "as asked";

/// The method without a network that a GPU can run, where it is asked for.
const FILTER: &str = "filter";

/// What the guard does.
const BLENDS: &str =
    "a blend of the plain estimates with experts, as far as samples that were held out support it";

/// A transformation, ready to be applied.
pub(crate) struct Method {
    /// `none`, the name of a built-in network or method, or a weights file.
    pub(crate) name: String,
    /// Why it was chosen, or what it does, in words for the summary.
    pub(crate) reason: &'static str,
    /// The GPU that is in use.
    pub(crate) adapter: Adapter,
    pub(crate) transform: Box<dyn Transform>,
}

impl Method {
    /// The method that the options ask for, for samples of this sampler; its name is empty
    /// where it is not known.
    pub(crate) fn resolve(args: &MethodArgs, sampler: &str) -> Result<Self, Error> {
        match (&args.weights, args.transform) {
            (Some(path), _) => Self::of_file(path, args.backend),
            (None, TransformArg::Auto) => Self::auto(&args.experts, sampler),
            (None, named) if !args.experts.is_empty() => Err(Error::Usage(format!(
                "--experts is for --transform auto, not for '{}'; leave out one of them",
                named.name()
            ))),
            (None, named) => Self::named(named, args.backend),
        }
    }

    /// The network of a weights file.
    pub(crate) fn of_file(path: &Path, backend: BackendArg) -> Result<Self, Error> {
        Self::network(path.display().to_string(), network_of(path)?, backend)
    }

    /// The guard, over these experts.
    pub(crate) fn auto(experts: &[ExpertArg], sampler: &str) -> Result<Self, Error> {
        Ok(Self::on_cpu(TransformArg::Auto.name(), BLENDS, guard(experts, sampler)?))
    }

    /// The method of a name; `auto` with the guard's own experts, for independent folds.
    pub(crate) fn named(transform: TransformArg, backend: BackendArg) -> Result<Self, Error> {
        match transform {
            TransformArg::Auto => Self::auto(&[], ""),
            TransformArg::None => Ok(Self::on_cpu("none", AS_ASKED, Box::new(Identity))),
            TransformArg::Method(FILTER) if backend == BackendArg::Gpu => {
                let adapter = Adapter::default();
                let transform = filter_on_gpu(&adapter)?;
                Ok(Self { name: FILTER.to_owned(), reason: AS_ASKED, adapter, transform })
            }
            TransformArg::Method(name) => {
                let method = method(name);
                let method =
                    method.unwrap_or_else(|| unreachable!("the command line admits known names"));
                Ok(Self::on_cpu(name, AS_ASKED, method))
            }
            TransformArg::Builtin(name) => Self::network(name, builtin(name)?, backend),
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

    fn on_cpu(name: &str, reason: &'static str, transform: Box<dyn Transform>) -> Self {
        Self { name: name.to_owned(), reason, adapter: Adapter::default(), transform }
    }

    fn network(
        name: impl Into<String>,
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
        Ok(Self { name: name.into(), reason: AS_ASKED, adapter, transform })
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
    opened(adapter, || open(AdapterKind::Any, network))
}

/// The filter on a GPU, or an error.
#[cfg(feature = "gpu")]
fn filter_on_gpu(adapter: &Adapter) -> Result<Box<dyn Transform>, Error> {
    opened(adapter, || {
        let gpu = Gpu::open(AdapterKind::Any)?;
        let name = gpu.name().to_owned();
        FilterGpu::new(gpu).map(|filter| (name, filter))
    })
}

/// What `open` opens on a GPU, which it names.
#[cfg(feature = "gpu")]
fn opened<T: Transform + 'static>(
    adapter: &Adapter,
    open: impl FnOnce() -> Result<(String, T), nst_core::Error>,
) -> Result<Box<dyn Transform>, Error> {
    let opening = adapter.opens();
    let opened = caught(open);
    drop(opening);
    let (name, transform) = opened.map_err(Error::Gpu)?;
    adapter.set(Some(name));
    Ok(Box::new(transform))
}

/// A network on a GPU if there is one, else on the CPU.
#[cfg(feature = "gpu")]
fn on_any(network: Arc<Network>, cpu: MlpCpu, adapter: &Adapter) -> Box<dyn Transform> {
    let open = move || open(AdapterKind::Hardware, network);
    Box::new(Fallback::new(open, cpu, adapter.clone()))
}

#[cfg(not(feature = "gpu"))]
fn on_gpu(_: Arc<Network>, adapter: &Adapter) -> Result<Box<dyn Transform>, Error> {
    filter_on_gpu(adapter)
}

#[cfg(not(feature = "gpu"))]
fn filter_on_gpu(_: &Adapter) -> Result<Box<dyn Transform>, Error> {
    let message = "--backend gpu: this nst was built without the feature 'gpu'";
    Err(Error::Usage(message.into()))
}

#[cfg(not(feature = "gpu"))]
fn on_any(_: Arc<Network>, cpu: MlpCpu, _: &Adapter) -> Box<dyn Transform> {
    Box::new(cpu)
}
