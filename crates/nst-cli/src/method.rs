//! Which transformation a command line stands for, and on what it runs.

use std::path::Path;

use nst_core::{
    BUILTIN, Identity, MlpCpu, Network, Transform,
    gpu::{AdapterKind, Gpu, MlpGpu},
};

use crate::{
    args::{BackendArg, MethodArgs, TransformArg},
    error::Error,
};

/// Terms that a rendering keeps where no network asks for a number.
pub(crate) const DEFAULT_WINDOW: usize = 8;

/// A transformation, ready to be applied.
pub(crate) struct Method {
    /// `none`, a built-in network's name, or a weights file.
    pub(crate) name: String,
    /// Why it was chosen, in words for the summary.
    pub(crate) reason: String,
    /// `cpu` or `gpu`.
    pub(crate) backend: &'static str,
    /// The GPU's name.
    pub(crate) adapter: Option<String>,
    pub(crate) transform: Box<dyn Transform>,
}

impl Method {
    /// Resolves the options for a sequence of `spp` samples of a scene.
    pub(crate) fn resolve(args: &MethodArgs, scene: &str, spp: u32) -> Result<Self, Error> {
        match &args.weights {
            Some(path) => Self::from_file(path, args.backend, spp),
            None => Self::named(args.transform, args.backend, scene, spp),
        }
    }

    /// Resolves a method by name for a sequence of `spp` samples of a scene.
    pub(crate) fn named(
        transform: TransformArg,
        backend: BackendArg,
        scene: &str,
        spp: u32,
    ) -> Result<Self, Error> {
        match transform {
            TransformArg::None => Ok(Self::none("as asked".to_owned())),
            TransformArg::Builtin(name) => {
                let network = builtin(name)?;
                check_window(name, &network, spp)?;
                Self::network(name.to_owned(), "as asked".to_owned(), network, backend)
            }
            TransformArg::Auto => match trained_on(scene, spp)? {
                Ok((name, network)) => {
                    let reason = format!("trained on this scene; {}", network.shape());
                    Self::network(name.to_owned(), reason, network, backend)
                }
                Err(reason) => Ok(Self::none(reason)),
            },
        }
    }

    fn from_file(path: &Path, backend: BackendArg, spp: u32) -> Result<Self, Error> {
        let network = Network::read(path)
            .map_err(|source| Error::Weights { path: path.to_owned(), source })?;
        let name = path.display().to_string();
        check_window(&name, &network, spp)?;
        Self::network(name, "as asked".to_owned(), network, backend)
    }

    fn none(reason: String) -> Self {
        let name = "none".to_owned();
        Self { name, reason, backend: "cpu", adapter: None, transform: Box::new(Identity) }
    }

    fn network(
        name: String,
        reason: String,
        network: Network,
        backend: BackendArg,
    ) -> Result<Self, Error> {
        let on_gpu = |kind| {
            let gpu = Gpu::open(kind)?;
            let adapter = gpu.name().to_owned();
            MlpGpu::new(gpu, network.clone()).map(|mlp| (adapter, mlp))
        };
        let gpu = match backend {
            BackendArg::Cpu => None,
            BackendArg::Gpu => Some(on_gpu(AdapterKind::Any).map_err(Error::Gpu)?),
            BackendArg::Auto => on_gpu(AdapterKind::Hardware).ok(),
        };
        Ok(match gpu {
            Some((adapter, mlp)) => Self {
                name,
                reason,
                backend: "gpu",
                adapter: Some(adapter),
                transform: Box::new(mlp),
            },
            None => Self {
                name,
                reason,
                backend: "cpu",
                adapter: None,
                transform: Box::new(MlpCpu::new(network)),
            },
        })
    }
}

fn builtin(name: &str) -> Result<Network, Error> {
    let network = Network::builtin(name);
    Ok(network.unwrap_or_else(|| unreachable!("the command line admits built-in names only"))?)
}

/// The built-in network for this very scene and sample count, or why there is none.
fn trained_on(scene: &str, spp: u32) -> Result<Result<(&'static str, Network), String>, Error> {
    let wanted = format!("scene:{scene}");
    for (name, _) in BUILTIN {
        let network = builtin(name)?;
        let metadata = network.metadata();
        if metadata.trained_on.contains(&wanted) {
            let (first, last) = metadata.samples;
            return Ok(if (first..=last).contains(&spp) {
                Ok((name, network))
            } else {
                Err(format!("network '{name}' was trained on {first} to {last} spp of this scene"))
            });
        }
    }
    Ok(Err("no network was trained on this very scene".to_owned()))
}

fn check_window(name: &str, network: &Network, spp: u32) -> Result<(), Error> {
    let window = network.metadata().window;
    if (spp as usize) < window {
        return Err(Error::Usage(format!(
            "network '{name}' reads the last {window} terms, but the sequence has {spp}; \
             use --spp {window} or more, or --transform none"
        )));
    }
    Ok(())
}
