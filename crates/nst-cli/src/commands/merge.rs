//! `nst merge`: sequences of one scene with different seeds → one sequence.

use nst_render::{merge::Merge, output::OutputFile};
use serde_json::json;

use super::{numbers, set_threads};
use crate::{args::MergeArgs, error::Error};

pub(crate) fn run(args: &MergeArgs) -> Result<(), Error> {
    set_threads(&args.common)?;
    if args.files.len() < 2 {
        return Err(Error::Usage("one sequence alone cannot be merged; name two or more".into()));
    }
    let merge = Merge::open(&args.files)?;
    let info = merge.info().clone();
    let mut output = OutputFile::create(&args.output)?;
    merge.write(&mut output)?;
    output.commit()?;
    if args.common.json {
        let json = json!({
            "files": args.files,
            "width": info.size[0],
            "height": info.size[1],
            "channels": info.model.channels(),
            "sample_counts": info.sample_counts,
            "seeds": info.seeds,
            "output": args.output,
        });
        println!("{json}");
    } else if !args.common.quiet {
        let [width, height] = info.size;
        let seeds: Vec<_> = info.seeds.iter().map(u64::to_string).collect();
        println!("sequences  {} of {width}x{height} pixels", args.files.len());
        println!("seeds      {}", super::list(&seeds, ""));
        println!("samples    {} per pixel", numbers(&info.sample_counts));
        println!("wrote      {}", args.output.display());
    }
    Ok(())
}
