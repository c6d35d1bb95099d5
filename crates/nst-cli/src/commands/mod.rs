pub(crate) mod bench;
pub(crate) mod compare;
pub(crate) mod info;
pub(crate) mod merge;
pub(crate) mod pack;
pub(crate) mod render;
mod resume;
pub(crate) mod transform;

use nst_core::{Estimates, SequenceBatch};
use nst_render::{VARIANCE, film, output::OutputFile};

use crate::{args::CommonArgs, error::Error};

/// The most numbers or names that a line of text lists.
const MOST_LISTED: usize = 12;

/// Writes the transformed picture with the layers `S` and `Variance`.
fn write_picture(
    output: &mut OutputFile,
    size: [u32; 2],
    batch: &SequenceBatch,
    estimates: &Estimates,
) -> Result<(), Error> {
    let mut layers = vec![("S", batch.last())];
    layers.extend(batch.side(VARIANCE).map(|variance| (VARIANCE, variance)));
    Ok(film::write_exr(output, size, estimates.values(), &layers)?)
}

/// Sets the number of threads of everything that follows.
fn set_threads(args: &CommonArgs) -> Result<(), Error> {
    if let Some(threads) = args.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(usize::from(threads))
            .build_global()
            .map_err(|error| Error::Usage(format!("--threads {threads}: {error}")))?;
    }
    Ok(())
}

/// Numbers, as [`list`] does names.
fn numbers(numbers: &[u32]) -> String {
    list(&numbers.iter().map(u32::to_string).collect::<Vec<_>>(), "none")
}

/// Names one after the other; the middle of a long list is left out.
fn list(names: &[impl AsRef<str>], none: &str) -> String {
    let names: Vec<_> = names.iter().map(AsRef::as_ref).collect();
    match names.len() {
        0 => none.to_owned(),
        1..=MOST_LISTED => names.join(", "),
        count => {
            let (start, end) = (&names[..MOST_LISTED / 2], &names[count - MOST_LISTED / 2..]);
            format!("{}, …, {} ({count})", start.join(", "), end.join(", "))
        }
    }
}
