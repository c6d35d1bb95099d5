//! The guard of the command line: over which experts, and where it has nothing to hold out.

#[cfg(feature = "gpu")]
use nst_core::gpu::{AdapterKind, Gpu};
use nst_core::{
    Error as CoreError, Estimates, Fitted, GuardNetwork, Identity, MlpCpu, Network, Requirements,
    SampleMlp, SequenceBatch, Strips, Transform, Weights, WelchFilter,
    guard::{
        Expert, Guard, GuardMlp, Judgement, OfTransform, PictureExpert, PictureGuard, TimeLimit,
    },
};

use crate::{
    adapter::Adapter,
    args::{BackendArg, CommonArgs, ExpertArg, GuardArg},
    error::Error,
    networks::{builtin, builtin_of_guard, builtin_of_samples, guard_network_of, network_of},
    oidn::{self, Oidn},
    report::warn,
    samples::evaluated,
};

/// The sampler whose folds are parts of one sequence, so that none says anything about the
/// error of the others.
const NESTED: &str = "halton";

/// Why the plain estimates stay then.
const NESTED_FOLDS: &str = "the folds of --sampler halton depend on each other, so that none can be \
                            held out; those of --sampler halton-folds do not";

/// A guard, and what its user should know of its experts.
pub(crate) struct Guarded {
    pub(crate) transform: Box<dyn Transform>,
    /// Why one of all experts takes no part.
    pub(crate) missing: Option<String>,
    /// The longest time that experts may take which nobody has named.
    pub(crate) limit: TimeLimit,
}

/// The experts if nobody names any.
const DEFAULT: [ExpertArg; 2] = [ExpertArg::Lane, ExpertArg::Filter];

/// The guard over the experts of a list, for samples of this sampler. If the list is empty, these are
/// its own and the filter, which keeps within the limit. The first networks that see samples are
/// also fitted again, as many as there is room for.
///
/// # Errors
/// [`Error::Usage`] says which expert cannot be one, and why.
pub(crate) fn guard(
    list: &[ExpertArg],
    weighs: Option<&GuardArg>,
    sampler: &str,
    backend: BackendArg,
    adapter: &Adapter,
    common: &CommonArgs,
) -> Result<Guarded, Error> {
    let named = if list.is_empty() { &DEFAULT } else { list };
    let limit = TimeLimit::default();
    let within = if list.is_empty() { limit.clone() } else { TimeLimit::default() };
    let Experts { lanes, of_pictures, guard, missing } =
        Experts::of(named, backend, adapter, common)?;
    let guarded = |transform| Guarded { transform, missing, limit };
    if of_pictures.is_empty() && matches!(weighs, Some(GuardArg::Learned | GuardArg::Weights(_))) {
        return Err(Error::Usage(
            "--guard: a network weighs experts that look at neighbours; add 'filter' or 'oidn' to \
             --experts"
                .into(),
        ));
    }
    if sampler == NESTED {
        let notes = vec![NESTED_FOLDS.to_owned()];
        let judgement = Judgement { ratio: 1.0, interval: [1.0; 2], notes, ..Judgement::default() };
        return Ok(guarded(Box::new(Kept(judgement))));
    }
    if of_pictures.is_empty() {
        return Ok(guarded(Box::new(guard)));
    }
    let guard = over_pictures(guard, lanes, of_pictures)?.within(within);
    Ok(guarded(Box::new(match network(weighs)? {
        Some(network) => guard.learned(weighing(network, backend, adapter)?),
        None => guard,
    })))
}

/// The guard over experts of which some look at neighbours.
///
/// # Errors
/// [`Error::Usage`] as for [`guard`], or if none looks at neighbours, or nothing can be held out.
pub(crate) fn guard_of_pictures(
    list: &[ExpertArg],
    sampler: &str,
    common: &CommonArgs,
) -> Result<PictureGuard, Error> {
    let (backend, adapter) = (BackendArg::Cpu, Adapter::default());
    let Experts { lanes, of_pictures, guard, .. } = Experts::of(list, backend, &adapter, common)?;
    if sampler == NESTED {
        return Err(Error::Usage(NESTED_FOLDS.into()));
    }
    if of_pictures.is_empty() {
        let message = "--experts: no one looks at neighbours; add 'filter' or 'oidn'";
        return Err(Error::Usage(message.into()));
    }
    over_pictures(guard, lanes, of_pictures)
}

/// The guard over experts that look at neighbours, and perhaps the lanes.
fn over_pictures(
    guard: Guard,
    lanes: bool,
    of_pictures: Vec<Box<dyn PictureExpert>>,
) -> Result<PictureGuard, Error> {
    let guard = PictureGuard::new(guard, of_pictures).map_err(usage)?;
    Ok(if lanes { guard } else { guard.without_lane() })
}

/// The network that weighs experts, if one does.
fn network(weighs: Option<&GuardArg>) -> Result<Option<GuardNetwork>, Error> {
    match weighs {
        Some(GuardArg::Closed) => Ok(None),
        Some(GuardArg::Learned) | None => builtin_of_guard().map(Some),
        Some(GuardArg::Weights(path)) => guard_network_of(path).map(Some),
    }
}

/// The experts of a list, ready to be asked.
struct Experts {
    /// Whether the guard's own take part.
    lanes: bool,
    of_pictures: Vec<Box<dyn PictureExpert>>,
    /// That of lanes, over networks.
    guard: Guard,
    /// Why one of all experts takes no part.
    missing: Option<String>,
}

impl Experts {
    fn of(
        named: &[ExpertArg],
        backend: BackendArg,
        adapter: &Adapter,
        common: &CommonArgs,
    ) -> Result<Self, Error> {
        let All { list, mut oidn, missing } = All::of(named, common);
        let lanes = list.contains(&ExpertArg::Lane);
        let mut networks = Vec::new();
        let mut of_pictures: Vec<Box<dyn PictureExpert>> = Vec::new();
        for arg in &list {
            match arg {
                ExpertArg::Lane => {}
                ExpertArg::Filter => of_pictures.push(Box::new(WelchFilter::default())),
                ExpertArg::Oidn => of_pictures.push(Box::new(match oidn.take() {
                    Some(oidn) => oidn,
                    None => Oidn::named(|library| loading(&library, common))?,
                })),
                other => networks.push(other),
            }
        }
        let refits = Guard::MOST_EXPERTS.saturating_sub(networks.len());
        let networks = networks.into_iter().enumerate();
        let networks = networks.map(|(i, arg)| expert(arg, i < refits, backend, adapter));
        let networks = networks.collect::<Result<Vec<_>, _>>()?;
        if !lanes && (of_pictures.is_empty() || !networks.is_empty()) {
            // Its first regression also says which lanes are alike.
            return Err(Error::Usage(
                "--experts: networks take part beside 'lane', the guard's own experts; add it to \
                 the list"
                    .into(),
            ));
        }
        if let Some((_, twice)) = list.iter().enumerate().find(|(i, it)| list[..*i].contains(it)) {
            return Err(Error::Usage(format!("--experts: '{twice}' is named twice")));
        }
        // The last one tells brightness, and denoisers leave less noise than filters.
        of_pictures.sort_by_key(|expert| expert.name() == oidn::NAME);
        Ok(Self { lanes, of_pictures, guard: Guard::new(networks).map_err(usage)?, missing })
    }
}

/// What the list of experts is to blame for.
fn usage(error: CoreError) -> Error {
    Error::Usage(format!("--experts: {}", reason(error)))
}

/// A list of experts in which `all` is replaced by those that can run here.
struct All {
    list: Vec<ExpertArg>,
    /// That of the list, where it was looked for.
    oidn: Option<Oidn>,
    /// Why it is not in the list.
    missing: Option<String>,
}

impl All {
    fn of(list: &[ExpertArg], common: &CommonArgs) -> Self {
        let (mut oidn, mut missing) = (None, None);
        let mut named = Vec::new();
        for arg in list {
            if *arg != ExpertArg::All {
                named.push(arg.clone());
                continue;
            }
            named.extend([ExpertArg::Lane, ExpertArg::Filter]);
            match Oidn::named(|library| loading(&library, common)) {
                Ok(found) => {
                    oidn = Some(found);
                    named.push(ExpertArg::Oidn);
                }
                Err(why) => missing = Some(format!("'oidn' takes no part: {why}")),
            }
        }
        Self { list: named, oidn, missing }
    }
}

/// Says which library is about to be loaded, as a damaged one may end the process.
fn loading(library: &str, common: &CommonArgs) {
    warn(&format!("loading    {library}"), common);
}

/// The expert of a name.
fn expert(
    arg: &ExpertArg,
    refit: bool,
    backend: BackendArg,
    adapter: &Adapter,
) -> Result<Box<dyn Expert>, Error> {
    let network = match arg {
        ExpertArg::All | ExpertArg::Lane | ExpertArg::Filter | ExpertArg::Oidn => {
            unreachable!("no networks")
        }
        ExpertArg::Builtin(name) => return of_terms(arg, builtin(name)?, "--transform"),
        ExpertArg::Samples(name) => builtin_of_samples(name)?,
        ExpertArg::Weights(path) => match network_of(path)? {
            Weights::Window(network) => return of_terms(arg, network, "--weights"),
            Weights::Samples(network) => network,
            Weights::Guard(_) => {
                let message =
                    format!("--experts: '{arg}' weighs experts, and is none; --guard takes it");
                return Err(Error::Usage(message));
            }
        },
    };
    let mlp: SampleMlp = evaluated(arg.to_string(), network, backend, adapter)?;
    Ok(Box::new(if refit { mlp.with_refit() } else { mlp }))
}

/// A network that weighs experts, with its layers where the command line wants them.
#[cfg(feature = "gpu")]
fn weighing(
    network: GuardNetwork,
    backend: BackendArg,
    adapter: &Adapter,
) -> Result<GuardMlp, Error> {
    if backend != BackendArg::Gpu {
        return Ok(GuardMlp::new(network));
    }
    adapter.open(|| {
        let gpu = Gpu::open(AdapterKind::Any)?;
        Ok((gpu.name().to_owned(), GuardMlp::on_gpu(network, &gpu)?))
    })
}

#[cfg(not(feature = "gpu"))]
fn weighing(network: GuardNetwork, _: BackendArg, _: &Adapter) -> Result<GuardMlp, Error> {
    Ok(GuardMlp::new(network))
}

/// The expert that a network which reads terms may be.
fn of_terms(arg: &ExpertArg, network: Network, option: &str) -> Result<Box<dyn Expert>, Error> {
    let expert = OfTransform::new(arg.to_string(), MlpCpu::new(network)).map_err(|error| {
        let why = reason(error);
        Error::Usage(format!("--experts: {why}; {option} {arg} applies it without the guard"))
    })?;
    Ok(Box::new(expert))
}

/// What an error says of experts.
fn reason(error: CoreError) -> String {
    match error {
        CoreError::Batch(why) => why,
        error => error.to_string(),
    }
}

/// Keeps the plain estimates, and says why.
struct Kept(Judgement);

impl Transform for Kept {
    fn requires(&self) -> Requirements {
        Identity.requires()
    }

    fn fit(&self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + '_>, CoreError> {
        Ok(Box::new(self))
    }
}

impl Fitted for Kept {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), CoreError> {
        Identity.apply(strip, out)
    }

    fn judgement(&self) -> Option<&Judgement> {
        Some(&self.0)
    }
}
