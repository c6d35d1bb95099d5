//! The methods of a bench: made ready once, and applied to runs.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
    time::{Duration, Instant},
};

use nst_core::{Estimates, FurtherPowers, SequenceBatch, guard::Judgement};

use super::source::{Needs, Origin, Run};
use crate::{
    args::{BackendArg, CommonArgs, ExpertArg, GuardArg, TransformArg},
    error::Error,
    method::Method,
    results::check_name,
    summary::why_kept,
    words::numbers,
};

/// The methods, each of which is made ready once.
pub(super) struct Methods {
    backend: BackendArg,
    common: CommonArgs,
    names: Vec<(String, Choice)>,
    ready: BTreeMap<String, Ready>,
    /// How long it took to open a GPU for the first network: drivers are loaded once in a
    /// process, and other networks would seem to be faster.
    opening: Option<Duration>,
    /// Why the guard kept the plain estimates, of which method, and at which sample counts.
    kept: BTreeMap<(String, String), BTreeSet<u32>>,
}

/// Where a method comes from.
#[derive(Clone)]
enum Choice {
    /// Not the guard.
    Named(TransformArg),
    /// The guard, with these experts, or its own if there are none, and what weighs them.
    Guard(Vec<ExpertArg>, Option<GuardArg>),
    Weights(PathBuf),
}

impl Choice {
    /// What a name stands for alone.
    fn named(transform: TransformArg) -> Self {
        match transform {
            TransformArg::Auto => Self::Guard(Vec::new(), None),
            transform => Self::Named(transform),
        }
    }
}

struct Ready {
    method: Method,
    /// How long it took to make it, to read a network for instance, without opening a GPU.
    making: Duration,
    /// How long it takes to open a GPU, or to find none; 0 where none is needed.
    opening: Duration,
    /// What its first transformation took beyond the second.
    warming: Option<Duration>,
}

/// Estimates of a method, and how long they took.
pub(super) struct Transformed {
    pub(super) values: Vec<f32>,
    /// What the method says of its own gain, if it measures it.
    pub(super) judgement: Option<Judgement>,
    /// A first transformation, and what is read for it.
    pub(super) cold: Duration,
    /// A second one.
    pub(super) warm: Duration,
    /// Opening a GPU, or finding none; `nst render` does it while it renders, unless
    /// `--backend gpu` asks for one.
    pub(super) opening: Opening,
    pub(super) adapter: Option<String>,
}

/// How long a GPU is being opened, and whether the rest of the job goes on meanwhile.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Opening {
    time: Duration,
    in_background: bool,
}

impl Opening {
    /// For how long a user waits who renders for so long; `None` where nothing is rendered.
    pub(super) fn waited(self, rendering: Option<Duration>) -> Duration {
        let meanwhile = rendering.filter(|_| self.in_background).unwrap_or_default();
        self.time.saturating_sub(meanwhile)
    }
}

impl Methods {
    /// The plain estimate, and then these, each once, and the networks of these files.
    ///
    /// # Errors
    /// [`Error::Usage`] if a file has the name of another method, or one that no table has.
    pub(super) fn new(
        asked: &[TransformArg],
        weights: &[PathBuf],
        experts: &[ExpertArg],
        guard: Option<&GuardArg>,
        backend: BackendArg,
        common: &CommonArgs,
    ) -> Result<Self, Error> {
        let mut names: Vec<(String, Choice)> = Vec::new();
        for &transform in [TransformArg::None].iter().chain(asked) {
            let (name, choice) = match transform {
                TransformArg::Auto => named_by(experts, guard)?,
                transform => (transform.name().to_owned(), Choice::Named(transform)),
            };
            if names.iter().all(|(earlier, _)| *earlier != name) {
                names.push((name, choice));
            }
        }
        for path in weights {
            let name = path.file_stem().unwrap_or_default().to_string_lossy();
            check_name(&name).map_err(|why| {
                Error::Usage(format!("--weights {}: {why}; rename the file", path.display()))
            })?;
            if TransformArg::named(&name).is_some() || names.iter().any(|(it, _)| *it == name) {
                return Err(Error::Usage(format!(
                    "--weights {}: there is another method '{name}'; rename the file",
                    path.display()
                )));
            }
            names.push((name.into_owned(), Choice::Weights(path.clone())));
        }
        let (ready, kept) = (BTreeMap::new(), BTreeMap::new());
        Ok(Self { backend, common: common.clone(), names, ready, opening: None, kept })
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.names.iter().map(|(name, _)| &**name)
    }

    /// How a method is made: one of this bench, or another that has a name.
    fn choice(&self, name: &str) -> Option<Choice> {
        let here = self.names.iter().find(|(known, _)| known == name);
        here.map(|it| it.1.clone()).or_else(|| TransformArg::named(name).map(Choice::named))
    }

    /// Whether a method can be applied: the file of a network may not be known.
    pub(super) fn can_make(&self, name: &str) -> bool {
        self.choice(name).is_some()
    }

    /// What these methods read of a rendering.
    pub(super) fn needs<'a>(
        &mut self,
        names: impl IntoIterator<Item = &'a str>,
        origin: &Origin,
    ) -> Result<Needs, Error> {
        let mut all = Needs { window: 1, powers: FurtherPowers::NONE, features: false };
        for name in names {
            let Some(choice) = self.choice(name) else { continue };
            let needs = self.ready(name, &choice, origin)?.method.transform.requires();
            all.window = all.window.max(needs.window);
            all.powers = all.powers.with(needs.powers);
            all.features |= needs.reads_features();
        }
        Ok(all)
    }

    /// Makes a method ready.
    fn ready(&mut self, name: &str, choice: &Choice, origin: &Origin) -> Result<&mut Ready, Error> {
        if !self.ready.contains_key(name) {
            let begin = Instant::now();
            let method = match choice {
                Choice::Named(named) => Method::named(*named, self.backend)?,
                Choice::Guard(experts, guard) => Method::auto(
                    experts,
                    guard.as_ref(),
                    &origin.sampler,
                    self.backend,
                    &self.common,
                )?,
                Choice::Weights(path) => Method::of_file(path, self.backend)?,
            };
            let mut making = begin.elapsed();
            let own = method.adapter.opening();
            if let Some(own) = own.filter(|_| self.backend == BackendArg::Gpu) {
                making = making.saturating_sub(own);
            }
            let opening = own.map(|own| *self.opening.get_or_insert(own)).unwrap_or_default();
            let ready = Ready { method, making, opening, warming: None };
            self.ready.insert(name.to_owned(), ready);
        }
        Ok(self.ready.get_mut(name).expect("it was put there"))
    }

    /// The estimates of a method that can be made, or why it fails on this run.
    pub(super) fn transform(
        &mut self,
        name: &str,
        origin: &Origin,
        batch: &SequenceBatch,
    ) -> Result<Transformed, String> {
        let in_background = self.backend == BackendArg::Auto;
        let choice = self.choice(name).ok_or("there is no such method")?;
        let ready = self.ready(name, &choice, origin);
        let ready = ready.map_err(|error| error.to_string())?;
        let opening = Opening { time: ready.opening, in_background };
        let window = ready.method.transform.requires().window;
        let terms = batch.sample_counts().len();
        if terms < window {
            return Err(format!("it reads the last {window} terms, but there are {terms}"));
        }
        let mut estimates = Estimates::default();
        let mut judgement = None;
        let mut once = || {
            let begin = Instant::now();
            let transformed = ready.method.transform(batch, &mut estimates);
            judgement = transformed.map_err(|error| error.to_string())?;
            Ok::<_, String>(begin.elapsed())
        };
        if ready.warming.is_none() {
            let first = once()?;
            ready.warming = Some(first.saturating_sub(once()?));
        }
        let warm = once()?;
        let transformed = Transformed {
            values: estimates.values().to_vec(),
            cold: warm + ready.making + ready.warming.unwrap_or_default(),
            warm,
            opening,
            adapter: ready.method.adapter(),
            judgement,
        };
        let spp = batch.sample_counts().last().copied().unwrap_or_default();
        if let Some(why) = transformed.judgement.as_ref().and_then(why_kept) {
            self.kept.entry((name.to_owned(), why)).or_default().insert(spp);
        }
        Ok(transformed)
    }

    /// The picture that a method makes of a run, if it does not fail.
    pub(super) fn picture(&mut self, name: &str, origin: &Origin, run: &Run) -> Option<Vec<f32>> {
        Some(self.transform(name, origin, &run.batch).ok()?.values)
    }

    /// Where the guard kept the plain estimates, of what was measured this time, and why.
    pub(super) fn notes(&self) -> Vec<String> {
        let note = |((name, why), spps): (&(String, String), &BTreeSet<u32>)| {
            let spps: Vec<u32> = spps.iter().copied().collect();
            format!("'{name}' kept the plain estimates at {} spp: {why}", numbers(&spps))
        };
        self.kept.iter().map(note).collect()
    }
}

/// The guard over these experts, and what a table calls it, with what weighs them if that is said.
fn named_by(experts: &[ExpertArg], guard: Option<&GuardArg>) -> Result<(String, Choice), Error> {
    if experts.contains(&ExpertArg::All) {
        let why = "--experts all: a table says which experts took part; name them, as in \
                   lane,filter,oidn";
        return Err(Error::Usage(why.into()));
    }
    let names: Vec<String> = experts.iter().map(ToString::to_string).collect();
    let mut name = TransformArg::Auto.name().to_owned();
    if !names.is_empty() {
        name += &format!(": {}", names.join(" + "));
    }
    if let Some(guard) = guard {
        name += &format!(" ({guard})");
    }
    check_name(&name).map_err(|why| Error::Usage(format!("--experts, --guard: {why}")))?;
    Ok((name, Choice::Guard(experts.to_vec(), guard.cloned())))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A GPU is opened for every network, which takes the first of a process longest; none of
    /// them is charged for another one.
    #[cfg(feature = "gpu")]
    #[test]
    fn all_networks_open_a_gpu_in_the_same_time() -> Result<(), String> {
        let asked = ["families", "cornell", "gmon"].map(TransformArg::named);
        let asked: Vec<TransformArg> = asked.into_iter().flatten().collect();
        let mut methods =
            Methods::new(&asked, &[], &[], None, BackendArg::Auto, &CommonArgs::default())
                .map_err(|error| error.to_string())?;
        let origin = Origin {
            scene: String::new(),
            fingerprint: String::new(),
            sampler: "random".into(),
            size: [5, 1],
        };
        let samples: Vec<f32> = (0..9 * 5).map(|i| ((i * i) % 11) as f32).collect();
        let batch = SequenceBatch::from_samples(5, &samples).map_err(|error| error.to_string())?;
        let families = methods.transform("families", &origin, &batch)?.opening;
        let cornell = methods.transform("cornell", &origin, &batch)?.opening;
        assert_eq!(families, cornell);
        assert!(families.time > Duration::ZERO && families.in_background, "{families:?}");
        let none = methods.transform("none", &origin, &batch)?.opening;
        assert_eq!(none.time, Duration::ZERO);
        Ok(())
    }

    /// The GPU of a network is opened while others render, in half a second, but not with
    /// `--backend gpu`.
    #[test]
    fn a_user_waits_for_what_the_rendering_does_not_hide() {
        let ms = Duration::from_millis;
        let opening = |in_background| Opening { time: ms(500), in_background };
        for (in_background, rendering, waited) in [
            (true, Some(ms(200)), ms(300)),
            (true, Some(ms(501)), ms(0)),
            (true, None, ms(500)),
            (false, Some(ms(200)), ms(500)),
        ] {
            assert_eq!(opening(in_background).waited(rendering), waited);
        }
        assert_eq!(Opening::default().waited(None), ms(0));
    }
}
