//! What would make `--transform auto` choose a network.

use nst_core::Network;
use nst_render::{PixelFilter, Scene};

/// Depths of paths that networks may have been trained with.
const DEPTHS: std::ops::RangeInclusive<u32> = 1..=8;

/// The options with which a scene is one that a built-in network was trained on, and the
/// network. Only scenes of its name are tried: others differ in more than options.
pub(in crate::commands) fn options_with_a_network(scene: &Scene) -> Option<(String, &'static str)> {
    let called = format!("scene:{}:v", scene.name);
    let networks: Vec<(&str, Network)> = Network::builtins()
        .filter_map(|builtin| Some((builtin.name(), builtin.network().ok()?)))
        .filter(|(_, network)| {
            network.metadata().trained_on.iter().any(|it| it.starts_with(&called))
        })
        .collect();
    if networks.is_empty() {
        return None;
    }
    let filters = [PixelFilter::Box, PixelFilter::Center];
    let mut tries: Vec<_> =
        filters.iter().flat_map(|&filter| DEPTHS.map(move |depth| (filter, depth))).collect();
    let changes = |&(filter, depth): &(PixelFilter, u32)| {
        (usize::from(filter != scene.pixel_filter) + usize::from(depth != scene.max_depth), depth)
    };
    tries.sort_by_key(changes);
    let mut tried = scene.clone();
    tries.into_iter().find_map(|(pixel_filter, max_depth)| {
        (tried.pixel_filter, tried.max_depth) = (pixel_filter, max_depth);
        let fingerprint = tried.fingerprint();
        let trained =
            |(_, network): &&(&str, Network)| network.metadata().trained_on_scene(&fingerprint);
        let (name, _) = networks.iter().find(trained)?;
        let mut options = Vec::new();
        if pixel_filter != scene.pixel_filter {
            options.push(format!("--pixel {pixel_filter}"));
        }
        if max_depth != scene.max_depth {
            options.push(format!("--max-depth {max_depth}"));
        }
        Some((options.join(" "), *name))
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn options_are_found() {
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
        let load = |path: &str| Scene::load(&scenes.join(path)).expect("a scene");
        let mut cornell = load("cornell/cornell.obj");
        let found = |scene: &Scene| options_with_a_network(scene);
        assert_eq!(found(&cornell), Some((String::new(), "cornell")));
        cornell.max_depth = 2;
        assert_eq!(found(&cornell), Some(("--pixel center".into(), "cornell-direct")));
        cornell.max_depth = 3;
        assert_eq!(found(&cornell), Some(("--max-depth 8".into(), "cornell")));
        cornell.camera.vertical_fov = 30.0;
        assert_eq!(found(&cornell), None);
        let plane = load("plane-lambert/plane-lambert.obj");
        assert_eq!(found(&plane), Some(("--pixel center".into(), "plane-lambert")));
        assert_eq!(found(&load("caustic/caustic.obj")), None);
    }
}
