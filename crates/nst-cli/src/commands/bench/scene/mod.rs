//! `nst bench scene`: the errors and times of methods on runs of one scene, one row each.

mod cache;
mod measure;
mod methods;
mod pictures;
mod reference;
mod report;
mod source;
mod table;

use std::time::Instant;

use nst_files::output::{Kind, Name, Outputs};
use nst_render::{LoadOptions, SamplerKind, Scene};

use crate::{
    args::{BenchSceneArgs, ExpertArg, GuardArg, TransformArg},
    commands::check_distinct,
    error::Error,
    interrupt,
    progress::Progress,
    report::Done,
    results::{PLAIN, Results, Row, beside},
    words::counted,
};
use measure::Meter;
use methods::Methods;
use reference::Reference;
use report::Report;
use source::{Origin, Run, Source};
use table::Table;

/// The longer side of the film, unless the command line or a reference says it: large enough
/// for stable means, small enough for some minutes.
const SIDE: u32 = 256;

/// Samples per pixel of each half of the reference, for each of the largest run. The noise
/// of the mean of both is then 1/32 of that run's.
const REFERENCE_FACTOR: u32 = 16;

/// What a method takes for a pixel, relative to a path: for the progress alone.
const PATHS_PER_METHOD: u64 = 8;

pub(super) fn run(args: &BenchSceneArgs) -> Result<Done, Error> {
    check_seeds(args)?;
    check_distinct(&[&args.reference[..], &args.sequence].concat())?;
    let of_experts = args.experts.iter().filter_map(ExpertArg::file);
    let of_guard = args.guard.iter().filter_map(GuardArg::file);
    let inputs = args.reference.iter().chain(&args.weights).chain(of_experts).chain(of_guard);
    let mut inputs: Vec<_> = inputs.cloned().collect();
    inputs.extend(args.picture.iter().map(|picture| picture.file.clone()));
    inputs.extend(args.sequence.clone());
    interrupt::finish_on_signal();
    let given =
        if args.reference.is_empty() { None } else { Some(Reference::read(&args.reference)?) };
    let (source, origin) = source(args, given.as_ref(), &mut inputs)?;
    // Before minutes are spent: the table is stored many times, the pictures once.
    let mut outputs = Outputs::of_inputs(&inputs);
    drop(outputs.open(&args.output, Kind::Csv, Name::Given)?);
    let pictures = outputs.open(&beside(&args.output), Kind::Picture, Name::Default)?;
    let mut table = Table::open(&args.output)?;
    let first_seed = matches!(source, Source::Scene { .. }).then_some(args.seed);
    let example = |row: Row| Row { method: PLAIN.into(), seed: first_seed, ..row };
    table.check_all_but_reference(example(origin.row()))?;
    let mut methods = methods(args)?;
    let reference = reference(args, given, &source, &table)?;
    if reference.size != origin.size {
        let [[w, h], [width, height]] = [reference.size, origin.size];
        return Err(Error::Unlike(format!(
            "the reference has {w}x{h} pixels, but the runs have {width}x{height}"
        )));
    }
    let meter = Meter { origin: &origin, reference: &reference, loading: source.loading() };
    let others = pictures::others(&meter, &args.picture)?;
    table.check(example(meter.blank()))?;
    table.check_sequences(source.sequences())?;
    // Networks of files may have changed.
    table.drop_rows(|row| {
        TransformArg::named(&row.method).is_none() && methods.names().any(|it| it == row.method)
    });
    measure(args, &meter, &source, &mut methods, &mut table)?;
    table.add(pictures::rows(&others))?;
    let results = Results::of(table.rows().iter().cloned())?;
    let files = [&args.output, pictures.path()].map(|path| path.display().to_string());
    let mut notes: Vec<String> = reference.notes().into_iter().collect();
    notes.extend(methods.notes());
    pictures::write(&meter, &source, &mut methods, others, &results, pictures)?;
    Ok(Done::whole(Report::of(&results, notes, files.into())))
}

/// The methods of the command line.
fn methods(args: &BenchSceneArgs) -> Result<Methods, Error> {
    let asked = if args.transform.is_empty() {
        TransformArg::all().collect()
    } else {
        args.transform.clone()
    };
    let BenchSceneArgs { weights, experts, guard, backend, common, .. } = args;
    let methods = Methods::new(&asked, weights, experts, guard.as_ref(), *backend, common)?;
    for name in args.picture.iter().map(|picture| &picture.name) {
        if methods.can_make(name) {
            return Err(Error::Usage(format!(
                "--picture {name}=…: a method has this name already"
            )));
        }
    }
    Ok(methods)
}

/// The reference that was given, or one that is rendered.
fn reference(
    args: &BenchSceneArgs,
    given: Option<Reference>,
    source: &Source,
    table: &Table,
) -> Result<Reference, Error> {
    match (given, source) {
        (Some(reference), _) => Ok(reference),
        (None, Source::Scene { scene, .. }) => {
            let largest = args.spp.iter().copied().max().unwrap_or_default();
            let default = largest.saturating_mul(REFERENCE_FACTOR);
            let spp = table.reference_spp(args.reference_spp, default)?;
            Reference::render(scene, spp, &args.common)
        }
        (None, Source::Files(_)) => unreachable!("clap asks for a reference"),
    }
}

fn check_seeds(args: &BenchSceneArgs) -> Result<(), Error> {
    let last = args.seed.checked_add(u64::from(args.runs - 1));
    // A reference that is rendered takes the last two.
    let free = |last: u64| !args.reference.is_empty() || last < reference::SEEDS[0];
    if last.is_some_and(free) {
        return Ok(());
    }
    Err(Error::Usage(format!(
        "--seed {} is too large for {}, whose seeds count up from it",
        args.seed,
        counted(args.runs as usize, "run")
    )))
}

/// What is measured: a scene, whose files are added to the inputs, or sequence files.
fn source(
    args: &BenchSceneArgs,
    reference: Option<&Reference>,
    inputs: &mut Vec<std::path::PathBuf>,
) -> Result<(Source, Origin), Error> {
    let Some(path) = &args.scene else { return Source::files(&args.sequence) };
    let begin = Instant::now();
    let reading = Progress::step(format!("reading {}", path.display()), &args.common);
    let size = args.size.or(reference.map(|reference| reference.size));
    let mut scene = Scene::load_with(path, &LoadOptions { size, ..Default::default() })?;
    drop(reading);
    let loading = begin.elapsed();
    if size.is_none() {
        scene.size = at_most(scene.size, SIDE);
    }
    if let Some(filter) = args.pixel {
        scene.pixel_filter = filter.into();
    }
    scene.max_depth = args.max_depth.unwrap_or(scene.max_depth);
    inputs.extend(scene.inputs.iter().cloned());
    let sampler = args.sampler.map_or(SamplerKind::Random, SamplerKind::from);
    let origin = Origin {
        scene: scene.name.clone(),
        fingerprint: scene.fingerprint(),
        sampler: sampler.to_string(),
        size: scene.size,
    };
    Ok((Source::Scene { scene: Box::new(scene), loading, sampler, seed: args.seed }, origin))
}

/// A size of the same shape, whose longer side is not larger than this.
fn at_most(size: [u32; 2], side: u32) -> [u32; 2] {
    let longer = size[0].max(size[1]);
    if longer <= side {
        return size;
    }
    let scaled = |length: u32| (u64::from(length) * u64::from(side)).div_ceil(longer.into()) as u32;
    size.map(scaled)
}

/// Measures what the table lacks, and stores it pair by pair.
fn measure(
    args: &BenchSceneArgs,
    meter: &Meter<'_>,
    source: &Source,
    methods: &mut Methods,
    table: &mut Table,
) -> Result<(), Error> {
    let names: Vec<String> = methods.names().map(str::to_owned).collect();
    let needs = methods.needs(names.iter().map(String::as_str), meter.origin)?;
    let lacks = |table: &Table, spp: u32, run: u32| {
        names.iter().filter(|name| !table.has(name, spp, run)).count() as u64
    };
    let pixels: u64 = meter.origin.size.map(u64::from).iter().product();
    let work = |table: &Table, spp: u32, runs: &[u32]| {
        let of_run = |&run: &u32| match lacks(table, spp, run) {
            0 => 0,
            methods => pixels * (u64::from(spp) + PATHS_PER_METHOD * methods),
        };
        runs.iter().map(of_run).sum::<u64>()
    };
    let pairs = source.pairs(args);
    let total = pairs.iter().map(|(spp, runs)| work(table, *spp, runs)).sum();
    let known =
        |table: &Table| pairs.iter().filter(|(spp, runs)| work(table, *spp, runs) == 0).count();
    let stopped = |table: &Table| {
        Error::Interrupted(format!(
            "{} of {} pairs of runs are in '{}'; the same command goes on from there",
            known(table),
            pairs.len(),
            args.output.display()
        ))
    };
    let progress = Progress::count("measuring", "bench", total, &args.common);
    for (spp, runs) in &pairs {
        let work = work(table, *spp, runs);
        if work == 0 {
            continue;
        }
        let mut batches: Vec<Run> = Vec::new();
        for &run in runs {
            batches.push(source.run(*spp, run, needs)?);
            meter.check_independent(&batches[batches.len() - 1])?;
            if interrupt::asked() {
                return Err(stopped(table));
            }
        }
        let wanted = |name: &str, run: u32| !table.has(name, *spp, run);
        let rows = meter.measure(methods, wanted, &batches)?;
        table.add(rows)?;
        progress.advance(work);
        if interrupt::asked() && known(table) < pairs.len() {
            return Err(stopped(table));
        }
    }
    Ok(())
}
