//! What Blender's renderer Cycles writes into its EXR files, and other programs do not: the
//! names of its passes, and the number of samples of each view layer.

/// The pass that is the picture, and the same before it was denoised.
const COMBINED: &str = "Combined";
const NOISY: &str = "Noisy Image";

/// Which of a file's layers are the picture among its passes, as in `ViewLayer.Combined`, also
/// of one eye of a stereo pair, as in `ViewLayer.Combined-left`. What the compositor has made
/// of them counts only if there is nothing else.
pub(crate) fn combined<'a>(layers: impl Iterator<Item = &'a str>) -> Vec<usize> {
    let all = layers.enumerate().filter_map(|(i, layer)| {
        let (view, eye) = layer.rsplit_once(COMBINED)?;
        let is_name = (view.is_empty() || view.ends_with('.'))
            && (eye.is_empty() || eye.starts_with(['-', '.']));
        is_name.then_some((i, view))
    });
    let (composites, views): (Vec<_>, Vec<_>) = all.partition(|&(_, view)| view == "Composite.");
    let found = if views.is_empty() { composites } else { views };
    found.into_iter().map(|(i, _)| i).collect()
}

/// The layer that has the picture before it was denoised; files have it where the picture is
/// denoised and the pass `Denoising Data` is on.
pub(crate) fn before_denoising(layer: &str) -> Option<String> {
    let (view, eye) = layer.rsplit_once(COMBINED)?;
    Some(format!("{view}{NOISY}{eye}"))
}

/// Which of a file's attributes, name and value, has the samples per pixel of a layer: its view
/// layer's `cycles.VIEW.samples`. The picture alone, and what the compositor has made, do not
/// name their view layer; all must agree there.
pub(crate) fn samples<'a>(
    attributes: impl Iterator<Item = (&'a str, &'a str)>,
    layer: &str,
) -> Option<(&'a str, &'a str)> {
    let all: Vec<_> = attributes
        .filter_map(|(name, value)| {
            let view = name.strip_prefix("cycles.")?.strip_suffix(".samples")?;
            Some((view, name, value))
        })
        .collect();
    // Names of view layers may have dots.
    let is_own = |view: &str| layer.strip_prefix(view).is_some_and(|rest| rest.starts_with('.'));
    let own = all.iter().filter(|(view, ..)| is_own(view)).max_by_key(|(view, ..)| view.len());
    let common =
        || all.first().filter(|(_, _, value)| all.iter().all(|(_, _, other)| other == value));
    own.or_else(common).map(|&(_, name, value)| (name, value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_of_the_layers_own_view() {
        let attributes = |list: &'static [(&str, &str)], layer: &str| {
            samples(list.iter().copied(), layer).map(|(_, value)| value)
        };
        let two: &[_] = &[("cycles.Key.samples", "8"), ("cycles.Key v1.2.samples", "4")];
        assert_eq!(attributes(two, "Key.Combined"), Some("8"));
        assert_eq!(attributes(two, "Key.Combined-left"), Some("8"));
        assert_eq!(attributes(two, "Key v1.2.Combined"), Some("4"));
        // Nobody knows which one they are made of.
        for layer in ["", "V", "Composite.Combined", "Keys.Combined"] {
            assert_eq!(attributes(two, layer), None, "{layer}");
        }
        let alike: &[_] = &[("cycles.A.samples", "8"), ("Date", "1"), ("cycles.B.samples", "8")];
        for layer in ["", "V", "Composite.Combined", "left", "A.Combined"] {
            assert_eq!(attributes(alike, layer), Some("8"), "{layer}");
        }
        assert_eq!(attributes(&[("cycles.A.total_time", "8"), ("samples", "8")], ""), None);
    }

    #[test]
    fn the_layer_before_denoising_is_beside_it() {
        let of = |layer| before_denoising(layer);
        assert_eq!(of("View.Combined").as_deref(), Some("View.Noisy Image"));
        assert_eq!(of("View.Combined-left").as_deref(), Some("View.Noisy Image-left"));
        assert_eq!(of("View.Normal"), None);
    }
}
