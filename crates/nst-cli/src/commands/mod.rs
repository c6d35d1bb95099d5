pub(crate) mod bench;
pub(crate) mod compare;
pub(crate) mod info;
pub(crate) mod render;
pub(crate) mod transform;

use nst_core::{Estimates, SequenceBatch};
use nst_render::{VARIANCE, film, output::OutputFile};

use crate::{args::CommonArgs, error::Error};

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
