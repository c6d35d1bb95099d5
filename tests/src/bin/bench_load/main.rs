//! How fast scenes are read, beside tobj, which reads the same file and makes no scene of it;
//! in a program of its own, so that nobody installs with `nst` what only a measurement needs.

mod terrain;

use std::{
    error::Error,
    fs::File,
    io::BufReader,
    path::{Path, PathBuf},
    process::ExitCode,
    time::Instant,
};

use clap::Parser;
use nst_render::{Lighting, LoadOptions, Scene};
use serde::Serialize;

/// Time the reading of a large OBJ file, by turns with tobj alone.
#[derive(Debug, Parser)]
struct Args {
    /// Squares along each side of the terrain, of two triangles each.
    #[arg(long, default_value_t = 362, value_parser = clap::value_parser!(u32).range(1..=2000))]
    squares: u32,
    /// Turns of each; the median counts.
    #[arg(long, default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    /// CSV file to write, with a row per turn.
    #[arg(short, long, value_name = "CSV")]
    output: Option<PathBuf>,
}

/// A turn.
#[derive(Debug, Serialize)]
struct Row {
    run: u32,
    /// `nst`: files to a scene; `tobj`: a file to its numbers.
    reader: &'static str,
    triangles: usize,
    megabytes: f64,
    milliseconds: f64,
}

fn main() -> ExitCode {
    nst_tests::exit_code(run(&Args::parse()))
}

fn run(args: &Args) -> Result<(), Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("terrain.obj");
    let obj = terrain::obj(args.squares);
    let megabytes = obj.len() as f64 / 1e6;
    std::fs::write(&path, obj)?;
    let triangles = 2 * args.squares as usize * args.squares as usize;
    let mut rows = Vec::new();
    for run in 0..args.runs {
        for reader in ["nst", "tobj"] {
            let begin = Instant::now();
            let read = if reader == "nst" { ours(&path)? } else { theirs(&path)? };
            let milliseconds = begin.elapsed().as_secs_f64() * 1e3;
            if read != triangles {
                return Err(format!("{reader} read {read} of {triangles} triangles").into());
            }
            rows.push(Row { run, reader, triangles, megabytes, milliseconds });
        }
    }
    let [nst, tobj] = ["nst", "tobj"].map(|reader| median(&rows, reader));
    println!("{triangles} triangles, {megabytes:.1} MB");
    println!("nst {nst:.0} ms, tobj {tobj:.0} ms: {:.2} of tobj", nst / tobj);
    if let Some(output) = &args.output {
        let mut output = csv::Writer::from_path(output)?;
        rows.iter().try_for_each(|row| output.serialize(row))?;
        output.flush()?;
    }
    Ok(())
}

/// Reads the scene, and counts its triangles, without a studio's lamps. What it frees
/// counts, as for tobj.
fn ours(path: &Path) -> Result<usize, Box<dyn Error>> {
    let options = LoadOptions { lighting: Some(Lighting::None), ..Default::default() };
    Ok(Scene::load_with(path, &options)?.triangles.len())
}

fn theirs(path: &Path) -> Result<usize, Box<dyn Error>> {
    let mut file = BufReader::new(File::open(path)?);
    let none = |_: &Path| Ok((vec![], Default::default()));
    let (models, _) = tobj::load_obj_buf(&mut file, &tobj::LoadOptions::default(), none)?;
    Ok(models.iter().map(|model| model.mesh.indices.len() / 3).sum())
}

fn median(rows: &[Row], reader: &str) -> f64 {
    let of_reader = rows.iter().filter(|row| row.reader == reader);
    let mut times: Vec<_> = of_reader.map(|row| row.milliseconds).collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}
