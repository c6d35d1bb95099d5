//! Which transformation the command line asks for, and what it runs on.

use std::{path::Path, sync::Arc, time::Duration};

#[cfg(feature = "gpu")]
use nst_core::gpu::{AdapterKind, FilterGpu, Gpu, MlpGpu};
use nst_core::{
    Estimates, Identity, Metadata, MlpCpu, Network, SampleNetwork, SequenceBatch, Side, Transform,
    Weights, Whole,
    guard::{Alone, Judgement, TimeLimit},
    methods::method,
};

#[cfg(feature = "gpu")]
use crate::fallback::Fallback;
use crate::{
    adapter::{Adapter, caught},
    args::{BackendArg, CommonArgs, ExpertArg, FILTER, GuardArg, MethodArgs, TransformArg},
    error::Error,
    guard::{Guarded, guard},
    networks::{builtin, builtin_of_samples, network_of},
    samples::{Lack, evaluated},
    words::list,
};

/// The last terms of a stored sequence, unless the method reads more: the window of the
/// built-in networks.
pub(crate) const DEFAULT_WINDOW: usize = 8;

/// The reason if the command line names the method.
const AS_ASKED: &str = "as asked";

/// What to tell where experts that look at neighbours know nothing but radiance.
const BLIND: &str = "there are no features by fold (albedo, normals, emission), so that what looks at \
     neighbours sees radiance alone; 'nst render --features --sequence' stores them, and 'nst pack'";

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
    /// The option that asks for it, if it is a network that sees samples, without the guard: where
    /// they lack what it needs, the job fails.
    pub(crate) needs_statistics: Option<String>,
    /// What a network was trained with that works without the guard.
    pub(crate) training: Option<Metadata>,
    /// Why one of all experts takes no part.
    pub(crate) missing: Option<String>,
    /// The longest time that experts may take which nobody has named.
    pub(crate) limit: TimeLimit,
}

/// What others may take at most: no more time than so many samples would, relative to those that
/// there are, as would lower MSE by as much as the filter does on average; or this time, in which
/// nobody waits for long. (docs/neighbours.md)
const OF_RENDERING: f64 = 1.0 / 3.0;
const AT_LEAST: Duration = Duration::from_secs(1);

impl Method {
    /// The method that the options ask for, for samples of this sampler; its name is empty
    /// where it is not known.
    pub(crate) fn resolve(
        args: &MethodArgs,
        sampler: &str,
        common: &CommonArgs,
    ) -> Result<Self, Error> {
        match (&args.weights, args.transform) {
            (Some(path), _) => Self::of_file(path, args.backend),
            (None, TransformArg::Auto) => {
                Self::auto(&args.experts, args.guard.as_ref(), sampler, args.backend, common)
            }
            (None, named) if !args.experts.is_empty() => Err(not_auto("--experts", named)),
            (None, named) if args.guard.is_some() => Err(not_auto("--guard", named)),
            (None, named) => Self::named(named, args.backend),
        }
    }

    /// The network of a weights file.
    pub(crate) fn of_file(path: &Path, backend: BackendArg) -> Result<Self, Error> {
        let name = path.display().to_string();
        match network_of(path)? {
            Weights::Window(network) => Self::network(name, network, backend),
            Weights::Samples(network) => {
                Self::of_samples(&name, format!("--weights {name}"), network, backend)
            }
            Weights::Guard(_) => Err(Error::Usage(format!(
                "--weights: '{name}' weighs the guard's experts, and is no transformation; --guard \
                 takes it"
            ))),
        }
    }

    /// The guard, over these experts.
    pub(crate) fn auto(
        experts: &[ExpertArg],
        weighs: Option<&GuardArg>,
        sampler: &str,
        backend: BackendArg,
        common: &CommonArgs,
    ) -> Result<Self, Error> {
        let adapter = Adapter::default();
        let guarded = guard(experts, weighs, sampler, backend, &adapter, common)?;
        let Guarded { transform, missing, limit } = guarded;
        let method = Self::on_cpu(TransformArg::Auto.name(), BLENDS, transform);
        Ok(Self { adapter, missing, limit, ..method })
    }

    /// Takes how long the samples took that it will transform. Without that, experts may take any
    /// time.
    pub(crate) fn rendered_in(&self, seconds: f32) {
        if let Ok(time) = Duration::try_from_secs_f32(seconds) {
            self.limit.set(time.mul_f64(OF_RENDERING).max(AT_LEAST));
        }
    }

    /// The method of a name; `auto` with the experts that it has by default, for independent folds.
    pub(crate) fn named(transform: TransformArg, backend: BackendArg) -> Result<Self, Error> {
        match transform {
            TransformArg::Auto => Self::auto(&[], None, "", backend, &CommonArgs::default()),
            TransformArg::None => Ok(Self::on_cpu("none", AS_ASKED, Box::new(Identity))),
            TransformArg::Method(FILTER) if backend == BackendArg::Gpu => {
                let adapter = Adapter::default();
                let method = Self::on_cpu(FILTER, AS_ASKED, filter_on_gpu(&adapter)?);
                Ok(Self { adapter, ..method })
            }
            TransformArg::Method(name) => {
                let method = method(name);
                let method =
                    method.unwrap_or_else(|| unreachable!("the command line admits known names"));
                Ok(Self::on_cpu(name, AS_ASKED, method))
            }
            TransformArg::Builtin(name) => Self::network(name, builtin(name)?, backend),
            TransformArg::Samples(name) => {
                let network = builtin_of_samples(name)?;
                Self::of_samples(name, format!("--transform {name}"), network, backend)
            }
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

    /// Fails if samples with these side channels lack what a network without the guard needs. Where
    /// the guard will leave one out for that, what to do is returned as a note.
    pub(crate) fn check_statistics(&self, sides: &[Side]) -> Result<Option<String>, Error> {
        match (Lack::of(&self.transform.requires(), sides), &self.needs_statistics) {
            (Some(lack), Some(option)) => {
                let why = lack.message(option);
                Err(Error::Usage(format!("'{}' sees the samples, but {why}", self.name)))
            }
            (Some(lack @ Lack::Powers(_)), None) => Ok(Some(lack.message("the same --experts"))),
            _ => Ok(None),
        }
    }

    /// What the user should know of the method, before it sees `samples` per pixel of such a sampler
    /// with these side channels.
    pub(crate) fn notes(
        &self,
        args: &MethodArgs,
        sides: &[Side],
        samples: u32,
        sampler: &str,
    ) -> Vec<String> {
        let of_features = [self.blind(sides), self.incomplete(sides)];
        let others = [self.unlike_training(samples, sampler), self.without_gpu(args)];
        let notes = [self.missing.clone()].into_iter().chain(of_features).chain(others);
        notes.flatten().collect()
    }

    /// Says so if a network was trained on other numbers of samples, or on those of another sampler.
    /// The sampler of other programs' files is not known.
    fn unlike_training(&self, samples: u32, sampler: &str) -> Option<String> {
        let Metadata { samples: (first, last), sampler: trained, .. } = self.training.as_ref()?;
        let trained = trained.as_deref().filter(|it| !sampler.is_empty() && *it != sampler);
        let of_count = (!(*first..=*last).contains(&samples))
            .then(|| format!("{first} to {last} samples, and there are {samples}"));
        let of_sampler = trained
            .map(|it| format!("samples of the sampler '{it}', and these are of '{sampler}'"));
        let unlike: Vec<String> = of_count.into_iter().chain(of_sampler).collect();
        (!unlike.is_empty()).then(|| {
            let unlike = unlike.join("; on ");
            format!(
                "'{}' was trained on {unlike}: it may be worse than the plain estimate",
                self.name
            )
        })
    }

    /// Says so if experts that look at neighbours will know nothing but radiance. Where nothing can
    /// be held out, they do not look at all.
    fn blind(&self, sides: &[Side]) -> Option<String> {
        let has_folds = Side::EVERY_OF_FOLDS.iter().all(|side| sides.contains(side));
        let has_features = sides.iter().any(|side| side.is_feature() && side.is_of_fold());
        let is_blind = self.transform.requires().reads_features() && has_folds && !has_features;
        is_blind.then(|| BLIND.to_owned())
    }

    /// Says which features take no part, as some of their folds are missing.
    fn incomplete(&self, sides: &[Side]) -> Option<String> {
        let is_missing = |side: &&Side| !sides.contains(side);
        let of_kinds = Side::FEATURE_FOLDS.iter();
        let some = of_kinds.filter(|folds| folds.iter().any(|side| sides.contains(side)));
        let missing = some.flat_map(|folds| folds.iter().filter(is_missing));
        let missing: Vec<String> = missing.map(Side::to_string).collect();
        let is_lost = self.transform.requires().reads_features() && !missing.is_empty();
        is_lost.then(|| {
            let missing = list(&missing, "");
            format!("no {missing}: a feature takes part if all of its folds are there")
        })
    }

    /// Says so if a GPU was asked for in vain, by the method or by experts of it.
    fn without_gpu(&self, args: &MethodArgs) -> Option<String> {
        if args.backend != BackendArg::Gpu {
            return None;
        }
        let has = |expert| args.experts.contains(&expert);
        let all = has(ExpertArg::All);
        let chosen = has(ExpertArg::Oidn) || (all && self.missing.is_none());
        let chosen = chosen.then_some("'oidn' chooses its device itself");
        let is_auto = args.weights.is_none() && args.transform == TransformArg::Auto;
        let stays = has(ExpertArg::Filter) || all || (is_auto && args.experts.is_empty());
        let stays = stays.then_some("the expert 'filter' stays on the CPU");
        // Such an expert has no part in what `backend` says.
        let others = match self.adapter() {
            None if chosen.is_some() => Some("nothing else runs on a GPU".to_owned()),
            None => {
                return Some(format!("--backend gpu: nothing of '{}' runs on a GPU", self.name));
            }
            Some(_) => None,
        };
        let parts = chosen.into_iter().chain(stays).map(str::to_owned).chain(others);
        let parts: Vec<String> = parts.collect();
        (!parts.is_empty()).then(|| format!("--backend gpu: {}", parts.join("; ")))
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
        let (name, adapter) = (name.to_owned(), Adapter::default());
        let limit = TimeLimit::default();
        Self {
            name,
            reason,
            adapter,
            transform,
            needs_statistics: None,
            training: None,
            missing: None,
            limit,
        }
    }

    /// A network that sees samples, without the guard; `option` asks for it.
    fn of_samples(
        name: &str,
        option: String,
        network: SampleNetwork,
        backend: BackendArg,
    ) -> Result<Self, Error> {
        let adapter = Adapter::default();
        let training = Some(network.metadata().clone());
        let mlp = evaluated(name.to_owned(), network, backend, &adapter)?;
        let method = Self::on_cpu(name, AS_ASKED, Box::new(Alone::new(mlp)));
        Ok(Self { adapter, needs_statistics: Some(option), training, ..method })
    }

    fn network(
        name: impl Into<String>,
        network: Network,
        backend: BackendArg,
    ) -> Result<Self, Error> {
        let training = Some(network.metadata().clone());
        let network = Arc::new(network);
        let cpu = MlpCpu::new(Arc::clone(&network));
        let adapter = Adapter::default();
        let transform: Box<dyn Transform> = match backend {
            BackendArg::Cpu => Box::new(cpu),
            BackendArg::Gpu => on_gpu(network, &adapter)?,
            BackendArg::Auto => on_any(network, cpu, &adapter),
        };
        let method = Self::on_cpu(&name.into(), AS_ASKED, transform);
        Ok(Self { adapter, training, ..method })
    }
}

/// The error where an option of the guard is given beside another method.
fn not_auto(option: &str, named: TransformArg) -> Error {
    let name = named.name();
    Error::Usage(format!(
        "{option} is for --transform auto, not for '{name}'; leave out one of them"
    ))
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
    let mlp = adapter.open(|| open(AdapterKind::Any, network))?;
    Ok(Box::new(mlp))
}

/// The filter on a GPU, or an error.
#[cfg(feature = "gpu")]
fn filter_on_gpu(adapter: &Adapter) -> Result<Box<dyn Transform>, Error> {
    let filter = adapter.open(|| {
        let gpu = Gpu::open(AdapterKind::Any)?;
        let name = gpu.name().to_owned();
        FilterGpu::new(gpu).map(|filter| (name, filter))
    })?;
    Ok(Box::new(filter))
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
