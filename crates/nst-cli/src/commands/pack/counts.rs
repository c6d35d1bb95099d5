//! How many samples per pixel the pictures have: from the command line, or else from the
//! files.

use nst_files::{pack::samples_in_name, picture::Picture};

use crate::error::Error;

/// Where the numbers of samples come from, in words.
pub(super) type Source = String;

/// The samples behind each of some independent renderings.
pub(super) fn samples_each(spp: Option<u32>, pictures: &[Picture]) -> Result<(u32, Source), Error> {
    if let Some(spp) = spp {
        return Ok((spp, "--spp, each".into()));
    }
    let first = &pictures[0];
    for picture in pictures {
        let path = picture.path().display();
        let Some(spp) = picture.samples_per_pixel else {
            let advice = "say with --spp with how many samples per pixel it was rendered";
            return Err(unclear(picture, advice).unwrap_or_else(|| {
                Error::Usage(format!(
                    "'{path}' does not say with how many samples per pixel it was rendered \
                     (attribute samplesPerPixel, or Blender's cycles.VIEW.samples); say it with --spp"
                ))
            }));
        };
        if Some(spp) != first.samples_per_pixel {
            return Err(Error::Unlike(format!(
                "'{path}' has {spp} samples per pixel, but '{}' has {}; independent renderings \
                 must have equally many",
                first.path().display(),
                first.samples_per_pixel.unwrap_or_default()
            )));
        }
    }
    Ok((first.samples_per_pixel.unwrap_or(1), format!("{}, each", attribute(first))))
}

/// The samples behind each snapshot of a progressive rendering.
pub(super) fn samples_of_estimates(
    list: Option<&[u32]>,
    pictures: &[Picture],
) -> Result<(Vec<u32>, Source), Error> {
    if let Some(list) = list {
        return Ok((list.to_vec(), "--spp-list".into()));
    }
    let from = |of: &dyn Fn(&Picture) -> Option<u32>| pictures.iter().map(of).collect();
    if let Some(counts) = from(&|picture| picture.samples_per_pixel) {
        return Ok((counts, attribute(&pictures[0])));
    }
    if let Some(counts) = from(&|picture| samples_in_name(picture.path())) {
        return Ok((counts, "the files' names".into()));
    }
    let advice = "list the numbers with --spp-list";
    if let Some(error) = pictures.iter().find_map(|picture| unclear(picture, advice)) {
        return Err(error);
    }
    let unknown = pictures.iter().find(|picture| samples_in_name(picture.path()).is_none());
    Err(Error::Usage(format!(
        "'{}' does not say how many samples per pixel it shows, neither in the attribute \
         samplesPerPixel nor in its name; list the numbers with --spp-list",
        unknown.unwrap_or(&pictures[0]).path().display()
    )))
}

/// The error of a picture that says something else than a number of samples; `advice` is what to do.
fn unclear(picture: &Picture, advice: &str) -> Option<Error> {
    let (path, unclear) = (picture.path().display(), picture.samples_unclear.as_ref()?);
    let message = format!("'{path}' says {unclear}, which is no whole number above 0; {advice}");
    Some(Error::Usage(message))
}

fn attribute(picture: &Picture) -> Source {
    format!("attribute {}", picture.samples_attribute.as_deref().unwrap_or_default())
}

/// Sorts pictures by their sample counts, which must differ.
pub(super) fn sort(pictures: &mut Vec<Picture>, counts: Vec<u32>) -> Result<Vec<u32>, Error> {
    let mut sorted: Vec<(u32, Picture)> = counts.into_iter().zip(pictures.drain(..)).collect();
    sorted.sort_by_key(|(count, _)| *count);
    if let Some(pair) = sorted.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        let [(count, first), (_, second)] = pair else { unreachable!("a window of two") };
        return Err(Error::Unlike(format!(
            "'{}' and '{}' both have {count} samples per pixel; the snapshots of one rendering \
             have different numbers (--spp-list gives them)",
            first.path().display(),
            second.path().display()
        )));
    }
    let (counts, sorted): (Vec<u32>, Vec<Picture>) = sorted.into_iter().unzip();
    *pictures = sorted;
    Ok(counts)
}
