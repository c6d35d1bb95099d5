//! Denoises a picture of raw numbers:
//!
//!     denoise WIDTH HEIGHT OUTPUT COLOR [ALBEDO [NORMAL]]
//!
//! The files have three f32 per pixel, little-endian, rows from the top; colours are HDR.
//! Says which library is loaded before it is, then its version and device.

use std::{error::Error, fs, process::ExitCode};

use nst_oidn::{Device, Image, Library};

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [width, height, output, color, features @ ..] = arguments.as_slice() else {
        return Err("denoise WIDTH HEIGHT OUTPUT COLOR [ALBEDO [NORMAL]]".into());
    };
    let color = read(color)?;
    let features = features.iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;

    let library = Library::find(|candidate| eprintln!("loading {candidate}"))?;
    let library = library.ok_or("Open Image Denoise is not installed")?;
    let device = Device::new(&library)?;
    eprintln!("Open Image Denoise {} on {}", device.version(), device.kind());

    let image = Image {
        albedo: features.first().map(Vec::as_slice),
        normal: features.get(1).map(Vec::as_slice),
        hdr: true,
        ..Image::new(width.parse()?, height.parse()?, &color)
    };
    let mut denoised = vec![0.0; color.len()];
    device.denoise(&image, &mut denoised)?;
    let bytes: Vec<u8> = denoised.iter().flat_map(|value| value.to_le_bytes()).collect();
    fs::write(output, bytes).map_err(|error| format!("cannot write '{output}': {error}").into())
}

fn read(path: &str) -> Result<Vec<f32>, String> {
    let bytes = fs::read(path).map_err(|error| format!("cannot read '{path}': {error}"))?;
    let (values, rest) = bytes.as_chunks::<4>();
    if !rest.is_empty() {
        return Err(format!("'{path}' is not a file of f32: {} bytes", bytes.len()));
    }
    Ok(values.iter().map(|&value| f32::from_le_bytes(value)).collect())
}
