//! One rendering: its sequence, what the transformation makes of it, and the pictures.

use std::{
    borrow::Cow,
    ops::Range,
    path::{Path, PathBuf},
};

use nst_core::{Estimates, Fitted, SequenceBatch, Side};
use nst_files::{
    ColorModel,
    output::{Kind, Name, OutputFile, Outputs},
    picture_writer::PictureInfo,
    sequence_file::{ResumeInfo, SequenceInfo, SequenceWriter},
};
use nst_render::{Band, Consumer, Control, Estimator, RenderSettings, Rendering, Scene, render_to};

use super::{
    describe, load_scene, outputs, paths, progress,
    resume::{self, Resumed, Start},
    settings,
};
use crate::{
    adapter::caught,
    args::{KeepArg, RenderArgs},
    commands::picture_files::{Further, PictureFiles, header, is_shown},
    error::Error,
    interrupt,
    method::Method,
    progress::Progress,
    report::{Done, say},
    summary::{Outcome, RenderStats, Stopwatch, timed},
};

/// A rendering that is about to begin.
struct Job<'a> {
    args: &'a RenderArgs,
    scene: Scene,
    fingerprint: String,
}

pub(super) fn run(args: &RenderArgs) -> Result<Done, Error> {
    let mut watch = Stopwatch::start();
    let resumed = timed(&mut watch.io, || args.resume.as_deref().map(resume::open).transpose())?;
    let stored = resumed.as_ref().map(|resumed| &resumed.info);
    let scene = timed(&mut watch.io, || load_scene(args, stored))?;
    let sampler = match &resumed {
        None => args.sampler.map_or_else(Default::default, Into::into),
        Some(resumed) => resumed.sampler,
    };
    let job = Job { args, fingerprint: scene.fingerprint(), scene };
    let method = Method::resolve(&args.method, &sampler.to_string(), &args.common)?;
    let advice =
        format!("use --spp {} or more, or --transform none", method.transform.requires().window);
    method.check_terms(args.spp as usize, &advice)?;
    let needs = method.transform.requires();
    let settings = match &resumed {
        None => RenderSettings {
            powers: needs.powers,
            features: args.features || needs.reads_features(),
            ..settings(args, needs.window, KeepArg::Window)
        },
        Some(resumed) => resumed.settings(args, &job.scene, &job.fingerprint, &method)?,
    };
    let features = Side::of_features(settings.spp).filter(|_| settings.features);
    let kept = Side::of_sums(settings.spp).chain(features).cloned();
    let sides: Vec<Side> = kept.chain(settings.powers.sides()).collect();
    let lacking = method.check_statistics(&sides)?;
    let lost = resumed.as_ref().and_then(Resumed::loss);
    // Opened before rendering, so that a path that cannot be written fails early.
    let files = Files::open(&job, resumed.as_ref())?;

    interrupt::finish_on_signal();
    let start = timed(&mut watch.io, || resumed.map(|it| read_start(it, args)).transpose())?;
    describe(&job.scene, args.spp, &args.common);
    if let Some(start) = &start {
        say(&format!("resumed    from {} spp", start.samples), &args.common);
    }
    let of_method = method.notes(&args.method, &sides, settings.spp, &sampler.to_string());
    let notes = lacking.into_iter().chain(lost).chain(of_method).collect();
    job.render(watch, method, &settings, files, start, notes)
}

/// Reads the sequence that is to be continued.
fn read_start(resumed: Resumed, args: &RenderArgs) -> Result<Start, Error> {
    let _step = Progress::step(format!("reading {}", resumed.path.display()), &args.common);
    resumed.read()
}

/// The files to write; the sequence only if it was asked for.
struct Files {
    sequence: Option<OutputFile>,
    picture: PictureFiles,
}

impl Files {
    fn open(job: &Job<'_>, resumed: Option<&Resumed>) -> Result<Self, Error> {
        let args = job.args;
        let path = args.output(&job.scene.name)?;
        let mut outputs: Outputs = outputs(args, &job.scene);
        // The sequence that is continued is replaced, unless --sequence names another.
        let sequence = match (&args.sequence, resumed) {
            (Some(path), Some(resumed)) if !same(path, &resumed.path) => {
                outputs.protect(&resumed.path);
                Some(path)
            }
            (None, Some(resumed)) => Some(&resumed.path),
            (path, _) => path.as_ref(),
        };
        let sequence =
            sequence.map(|path| outputs.open(path, Kind::Sequence, Name::Given)).transpose()?;
        let picture = PictureFiles::open(&mut outputs, &path, args.output_name())?;
        Ok(Self { sequence, picture })
    }
}

fn same(a: &Path, b: &PathBuf) -> bool {
    a == b || a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b))
}

impl Job<'_> {
    fn render(
        &self,
        mut watch: Stopwatch,
        method: Method,
        settings: &RenderSettings,
        files: Files,
        start: Option<Start>,
        further_notes: Vec<String>,
    ) -> Result<Done, Error> {
        let Self { args, scene, .. } = self;
        let Files { sequence, picture } = files;
        let (done, spent) = start.as_ref().map_or((0, 0.0), |start| (start.samples, start.seconds));
        let bar = progress(scene, paths(scene, args.spp - done), &args.common);
        let advance = |paths| bar.advance(paths);
        let control = Control { progress: &advance, stop: &interrupt::asked };
        let start = start.map(|start| start.from);
        let mut estimated = Estimated::new(scene.size);
        let put = |rows, estimates: &_| estimated.put(rows, estimates);
        let mut estimator = caught(|| Estimator::new(&*method.transform, put));
        let sides = estimator.as_ref().ok().and_then(Estimator::sides);
        let mut take = |band: Band| {
            if let Ok(it) = &mut estimator
                && let Err(error) = caught(|| it.add(&band.rows))
            {
                estimator = Err(error);
            }
        };
        let consumer = sides.map(|sides| Consumer { sides, take: &mut take });
        let rendering = render_to(consumer, start, scene, settings, control)?;
        drop(bar);

        let _rest = Progress::step("transforming and writing", &args.common);
        // The samples are stored first: if a later step fails, they are not lost.
        let mut written = Vec::new();
        timed(&mut watch.io, || sequence.map(|file| self.store(file, settings, &rendering, spent)))
            .transpose()?
            .into_iter()
            .for_each(|path| written.push(path));
        let samples = rendering.samples();
        let seconds = spent + rendering.time.as_secs_f32();
        method.rendered_in(seconds);
        let transformed = timed(&mut watch.transform, || {
            estimator.and_then(|it| caught(|| it.finish(&rendering)))
        });
        let fitted = transformed.map(|fitted| estimated.complete(&*fitted));
        let shown = fitted.is_ok().then_some(&estimated);
        let with_features = args.features || args.resume.is_some();
        let judgement = shown.and_then(|it| it.outcome.judgement.as_ref());
        let info = header(samples, Some(seconds), judgement);
        written.extend(timed(&mut watch.io, || {
            write(&rendering, with_features, picture, shown, &info)
        })?);
        fitted.map_err(|why| {
            let saved = format!("{} show the plain estimates", written.join(", "));
            Error::Transform { why: why.to_string(), saved }
        })?;

        let stats = RenderStats {
            samples,
            time: rendering.time,
            build_time: rendering.build_time,
            paths: paths(scene, samples - done),
        };
        let mut notes = self.notes(&rendering);
        notes.extend(further_notes);
        let report = watch.summary(
            Some(stats),
            &method,
            estimated.outcome,
            written,
            (notes, scene.notes.len()),
        );
        let early = (samples < args.spp).then(|| self.missing(samples));
        Ok(Done { report: Box::new(report), early })
    }

    /// Writes the sequence of a rendering that had taken `spent` seconds before it was
    /// continued; returns its path.
    fn store(
        &self,
        mut output: OutputFile,
        settings: &RenderSettings,
        rendering: &Rendering,
        spent: f32,
    ) -> Result<String, Error> {
        let scene = &self.scene;
        let info = SequenceInfo {
            size: scene.size,
            model: ColorModel::Rgb,
            sample_counts: rendering.sample_counts(),
            sides: rendering.sides(),
            scene: self.fingerprint.clone(),
            sampler: settings.sampler.to_string(),
            seeds: vec![settings.seed],
            render_seconds: spent + rendering.time.as_secs_f32(),
            resume: Some(ResumeInfo {
                keep: settings.keep,
                pixel_filter: scene.pixel_filter.to_string(),
                max_depth: scene.max_depth,
                russian_roulette: scene.russian_roulette,
                powers: settings.powers,
            }),
        };
        let mut writer = SequenceWriter::create(&mut output, &info)?;
        let mut strips = rendering.strips();
        while let Some(strip) = strips.next_rows() {
            let rows = rows(&strip);
            let sums = rendering.sums(rows.start as u32..rows.end as u32);
            writer.push(&strip, Some(&sums))?;
        }
        writer.finish()?;
        let path = output.path().display().to_string();
        output.commit()?;
        Ok(path)
    }

    fn notes(&self, rendering: &Rendering) -> Vec<String> {
        let mut notes = self.scene.notes.clone();
        match rendering.skipped() {
            0 => {}
            1 => notes.push("1 sample was not finite and counts as black".into()),
            count => notes.push(format!("{count} samples were not finite and count as black")),
        }
        let background = self.scene.environment.background.map(|rgb| rgb.to_array());
        let lanes = rendering.last();
        let shows = |rgb: [f32; 3]| {
            lanes.chunks(lanes.len() / 3).zip(rgb).all(|(lanes, x)| lanes.iter().all(|&y| y == x))
        };
        if shows([0.0; 3]) {
            notes.push("the picture is black: no light reaches what the camera sees".into());
        } else if background.is_some_and(shows) {
            notes.push("the picture shows the background alone: nothing is where it looks".into());
        }
        notes
    }

    /// What is missing of a rendering that was stopped early, and how to continue it.
    fn missing(&self, samples: u32) -> String {
        let Self { args, .. } = self;
        let sequence = args.sequence.as_ref().or(args.resume.as_ref());
        let how = match sequence {
            Some(path) => format!("; --resume '{}' goes on from there", path.display()),
            None => String::new(),
        };
        format!("{samples} of {} spp are in the files{how}", args.spp)
    }
}

/// The rows of the picture that a strip has.
fn rows(strip: &SequenceBatch) -> Range<usize> {
    let grid = strip.grid().expect("strips of renderings have a grid");
    let inner = grid.inner_rows();
    let first = grid.first_row() as usize;
    first + inner.start..first + inner.end
}

/// What a method makes of a rendering.
struct Estimated {
    /// Planar lanes of the whole picture.
    values: Vec<f32>,
    /// Their errors, in the same way; empty if the method estimates none.
    errors: Vec<f32>,
    /// The experts' weights, `[expert][pixel]`; empty if there are none.
    weights: Vec<f32>,
    /// What the method says of all rows beside the values.
    further: Further,
    pixels: usize,
    width: usize,
    outcome: Outcome,
}

impl Estimated {
    /// Of no rows yet. It takes memory from the first ones on: whether a picture fits is not
    /// known before it is rendered.
    fn new([width, height]: [u32; 2]) -> Self {
        let (width, pixels) = (width as usize, (width as usize).saturating_mul(height as usize));
        let [values, errors, weights] = [Vec::new(), Vec::new(), Vec::new()];
        let (further, outcome) = (Further::default(), Outcome::default());
        Self { values, errors, weights, further, pixels, width, outcome }
    }

    /// Takes the estimates of some rows.
    fn put(&mut self, rows: Range<usize>, estimates: &Estimates) {
        let place = rows.start * self.width..rows.end * self.width;
        let pictures = [
            (&mut self.values, estimates.values()),
            (&mut self.errors, estimates.errors()),
            (&mut self.weights, estimates.weights()),
        ];
        for (picture, rows) in pictures.into_iter().filter(|(_, rows)| !rows.is_empty()) {
            picture.resize(self.pixels * (rows.len() / place.len()), 0.0);
            let planes = picture.chunks_exact_mut(self.pixels);
            for (plane, rows) in planes.zip(rows.chunks_exact(place.len())) {
                plane[place.clone()].copy_from_slice(rows);
            }
        }
        self.outcome.add(estimates);
    }

    /// Takes what the method says of all rows.
    fn complete(&mut self, fitted: &dyn Fitted) {
        self.further = Further::of(fitted);
        if self.further.errors {
            self.errors.resize(self.values.len(), 0.0);
        }
        self.outcome.judgement = fitted.judgement().cloned();
    }

    /// Some rows of the estimates, of their errors, or of the weights.
    fn get(&self, picture: &[f32], rows: Range<usize>) -> Vec<f32> {
        let place = rows.start * self.width..rows.end * self.width;
        let planes = picture.chunks_exact(self.pixels);
        planes.flat_map(|plane| &plane[place.clone()]).copied().collect()
    }

    /// Some rows of what is known beside the values: errors, then weights.
    fn parts(&self, rows: Range<usize>) -> Vec<Vec<f32>> {
        let pictures = [&self.errors, &self.weights].into_iter().filter(|it| !it.is_empty());
        pictures.map(|picture| self.get(picture, rows.clone())).collect()
    }
}

/// Writes the picture, of plain estimates where there are no others, and the PNG; returns
/// their paths. Features that a method alone wants are not in it.
fn write(
    rendering: &Rendering,
    with_features: bool,
    mut files: PictureFiles,
    estimated: Option<&Estimated>,
    info: &PictureInfo,
) -> Result<Vec<String>, Error> {
    let mut sides = rendering.sides();
    sides.retain(|side| with_features || !side.is_feature());
    let further = estimated.map(|it| it.further.clone()).unwrap_or_default();
    let mut picture = files.begin(rendering.size(), ColorModel::Rgb, &sides, &further, info)?;
    let shown = sides.iter().filter(|&side| *side == Side::Variance || is_shown(side));
    let mut strips = rendering.strips().with_sides(&shown.cloned().collect::<Vec<_>>());
    while let Some(strip) = strips.next_rows() {
        let plain = || Cow::Borrowed(strip.last());
        let of_rows = rows(&strip);
        let further = estimated.map(|it| it.parts(of_rows.clone())).unwrap_or_default();
        let values = estimated.map_or_else(plain, |it| it.get(&it.values, of_rows).into());
        picture.push(&strip, &values, &further.iter().map(Vec::as_slice).collect::<Vec<_>>())?;
    }
    picture.finish()?;
    files.commit()
}
