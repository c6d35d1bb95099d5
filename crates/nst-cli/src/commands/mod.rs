pub(crate) mod bench;
pub(crate) mod render;
pub(crate) mod transform;

use crate::{args::CommonArgs, error::Error};

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
