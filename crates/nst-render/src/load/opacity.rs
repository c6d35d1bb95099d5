//! Which materials light passes through: the summary names them, as a file may mean something else.

use super::report::Report;
use crate::{Material, Scattering, Triangle};

/// Names the materials in use that are not opaque. Where nothing at all would be seen of a
/// scene, its materials are opaque instead.
pub(super) fn settle(triangles: &[Triangle], materials: &mut [Material], report: &mut Report) {
    let mut in_use = vec![false; materials.len()];
    triangles.iter().for_each(|triangle| in_use[triangle.material as usize] = true);
    let invisible = |material: &Material| material.opacity == 0.0;
    if materials.iter().zip(&in_use).all(|(material, &used)| !used || invisible(material)) {
        materials.iter_mut().for_each(|material| material.opacity = 1.0);
        report.note("nothing of the scene would be visible: its materials are taken for opaque");
    }
    let mut names: Vec<String> = Vec::new();
    for (material, _) in materials.iter().zip(in_use).filter(|(_, used)| *used) {
        if let Some(kind) = kind(material) {
            let name = format!("{} ({kind})", material.name);
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    if !names.is_empty() {
        report.note(format!("not opaque: {}", names.join(", ")));
    }
}

/// In which way the material is not opaque.
fn kind(material: &Material) -> Option<String> {
    match material.scattering {
        Scattering::Dielectric { .. } => Some("glass".to_owned()),
        Scattering::ThinDielectric { .. } => Some("thin glass".to_owned()),
        _ if material.opacity_texture.is_some() => Some("cut-out".to_owned()),
        _ if material.opacity == 0.0 => Some("invisible".to_owned()),
        _ if material.opacity < 1.0 => Some(format!("opacity {}", material.opacity)),
        _ => None,
    }
}
