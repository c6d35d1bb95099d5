//! Materials from an MTL file; `docs/scenes.md` has the table of keys.

mod context;
mod map;
mod options;
mod statements;

use std::path::Path;

use glam::Vec3A;

use super::{
    exact::fourth_root,
    image::Images,
    maps::{Channel, Meaning, are_normals},
    ranges::IOR,
    report::Report,
    text::{self, quoted},
};
use crate::{Disney, Error, Material, Relief, Scattering, TextureMap, material::GREY};

use self::{
    context::{Context, OUT_OF_RANGE},
    map::Map,
    statements::Statements,
};

/// Reads the materials of an MTL file.
///
/// # Errors
/// When the file cannot be read. Where loading is strict: names the line, the material and the
/// key that is malformed; or the image.
pub(super) fn load(
    path: &Path,
    images: &mut Images,
    report: &mut Report,
) -> Result<Vec<Material>, Error> {
    let text = text::read(path, report)?;
    let mut all: Vec<Statements> = Vec::new();
    for line in text::lines(&text) {
        let key = line.keyword().to_ascii_lowercase();
        if key == "newmtl" {
            if line.name().is_empty() {
                let fault = || "newmtl without a name".to_owned();
                report.forgive("materials without a name", path, line.number, fault)?;
            }
            all.push(Statements { name: line.name().to_owned(), ..Default::default() });
        } else if let Some(statements) = all.last_mut() {
            statements.read(path, &key, &line, report)?;
        } else {
            let kind = "statements of no material, left out";
            let fault = || format!("{} before the first newmtl", quoted(line.keyword()));
            report.forgive(kind, path, line.number, fault)?;
        }
    }
    let context = &mut Context { path, images, report };
    all.into_iter().map(|statements| statements.material(context)).collect()
}

impl Statements {
    fn material(self, context: &mut Context) -> Result<Material, Error> {
        let glass = self.glass();
        let scattering = match glass {
            Some(ior) => Scattering::Dielectric { ior: self.limited(ior, context)? },
            None => self.scattering(),
        };
        let (color, color_texture) =
            self.tinted(self.kd, self.map_kd.as_ref(), Meaning::Reflectance, context)?;
        let (emission, emission_texture) =
            self.tinted(self.ke, self.map_ke.as_ref(), Meaning::Radiance, context)?;
        let mut material = Material {
            name: self.name.clone(),
            color: color.unwrap_or(Vec3A::splat(GREY)),
            color_texture,
            emission: emission.unwrap_or(Vec3A::ZERO),
            emission_texture,
            relief: self.relief(context)?,
            scattering,
            ..Material::default()
        };
        if let Scattering::Dielectric { ior } = scattering {
            make_dielectric(&mut material, ior);
            return Ok(material);
        }
        material.opacity = self.opacity(context.report);
        material.opacity_texture = self.opacity_texture(context)?;
        if let Some(ks) = self.mirror() {
            material.color = ks;
        }
        Ok(material)
    }

    /// A colour and the texture that it multiplies. Black times a texture is what some exporters
    /// write, but nobody means: the texture alone counts, or nothing, if it cannot be read.
    fn tinted(
        &self,
        color: Option<Vec3A>,
        map: Option<&Map>,
        meaning: Meaning,
        context: &mut Context,
    ) -> Result<(Option<Vec3A>, Option<TextureMap>), Error> {
        let Some(map) = map else { return Ok((color, None)) };
        let texture = map.texture(&self.name, meaning, None, context)?;
        let tint = color.filter(|&color| color != Vec3A::ZERO);
        Ok((if texture.is_some() { tint.or(Some(Vec3A::ONE)) } else { tint }, texture))
    }

    /// The index of refraction of clear glass. Neither `illum` alone says that a material is
    /// glass (Maya writes 4 for all), nor transparency alone (leaves and decals have it).
    fn glass(&self) -> Option<f32> {
        let refracts = matches!(self.illum, 4 | 6 | 7 | 9);
        let opacity = self.d.unwrap_or(1.0 - self.tr.unwrap_or(0.0));
        let is_clear = opacity < 1.0 || self.tf.is_some_and(|tf| tf.max_element() > 0.0);
        self.ni.map(|(_, ni)| ni).filter(|&ni| refracts && is_clear && ni > 1.0)
    }

    fn limited(&self, ior: f32, context: &mut Context) -> Result<f32, Error> {
        let most = *IOR.end();
        if ior > most {
            let line = self.ni.map_or(0, |(line, _)| line);
            let (name, least) = (quoted(&self.name), IOR.start());
            let rule = format!("of a transparent material is not within {least} and {most}");
            let fault = || format!("material {name}: Ni {ior} {rule}");
            context.report.forgive(OUT_OF_RANGE, context.path, line, fault)?;
        }
        Ok(ior.min(most))
    }

    /// Opacity without its texture. Programs disagree about which of 0 and 1 is opaque: where
    /// a file says that nothing is to be seen of a surface, and describes it all the same, it
    /// is opaque.
    fn opacity(&self, report: &mut Report) -> f32 {
        let textured = self.map_kd.is_some() || self.map_d.is_some();
        let (opacity, key, meant) = match (self.d, self.tr) {
            (Some(d), tr) => (d, "d 0", textured || tr == Some(0.0)),
            (None, Some(tr)) => (1.0 - tr, "Tr 1", textured || self.illum <= 2),
            (None, None) => (1.0, "", false),
        };
        if opacity == 0.0 && meant {
            let beside =
                if key == "d 0" { "Tr 0 or a texture" } else { "illum up to 2 or a texture" };
            report.note(format!("{key} beside {beside} taken for opaque"));
            return 1.0;
        }
        opacity
    }

    /// The texture of `map_d`, unless it is opaque. A picture that is the colour as well says
    /// something about opacity by its alpha channel alone.
    fn opacity_texture(&self, context: &mut Context) -> Result<Option<TextureMap>, Error> {
        let Some(map) = &self.map_d else { return Ok(None) };
        let is_color = self.map_kd.as_ref().is_some_and(|color| color.file == map.file);
        let channel = is_color.then_some(Channel::Alpha);
        let texture = map.texture(&self.name, Meaning::Opacity, channel, context)?;
        Ok(texture.filter(|texture| texture.image.texels().iter().any(|texel| texel[0] < 1.0)))
    }

    /// Of normals and bumps, the normals; a bump map that contains normals is a normal map.
    fn relief(&self, context: &mut Context) -> Result<Option<Relief>, Error> {
        if let Some(map) = &self.norm {
            let normals = map.texture(&self.name, Meaning::Normals, None, context)?;
            return Ok(normals.map(|normals| normal_map(map, normals, context.report)));
        }
        let Some(map) = &self.bump else { return Ok(None) };
        let Some(normals) = map.texture(&self.name, Meaning::Normals, None, context)? else {
            return Ok(None);
        };
        if are_normals(&normals.image) {
            context.report.note("bump maps that contain normals, used as normal maps");
            return Ok(Some(normal_map(map, normals, context.report)));
        }
        let heights = map.texture(&self.name, Meaning::Heights, None, context)?;
        let scale = map.options.multiplier;
        Ok(heights.map(|map| Relief::Bumps { map, scale }))
    }

    fn scattering(&self) -> Scattering {
        if let Some(disney) = self.pbr() {
            return Scattering::Disney(disney);
        }
        let Some((ks, ns)) = self.highlight() else { return Scattering::Lambert };
        Scattering::Disney(Disney {
            specular: ks.max_element(),
            // α² = 2 / (Ns + 2), where α = roughness².
            roughness: fourth_root(2.0 / (ns + 2.0)),
            metallic: if self.mirror().is_some() { 1.0 } else { 0.0 },
            ..Default::default()
        })
    }

    /// The parameters of the PBR extension, if there are any.
    fn pbr(&self) -> Option<Disney> {
        let keys = [self.pr, self.pm, self.ps, self.pc, self.pcr, self.aniso];
        let plain = Disney::default();
        keys.iter().any(Option::is_some).then(|| Disney {
            roughness: self.pr.unwrap_or(plain.roughness),
            metallic: self.pm.unwrap_or(plain.metallic),
            sheen: self.ps.unwrap_or(plain.sheen),
            clearcoat: self.pc.unwrap_or(plain.clearcoat),
            clearcoat_gloss: self.pcr.map_or(plain.clearcoat_gloss, |rough| 1.0 - rough),
            anisotropic: self.aniso.unwrap_or(plain.anisotropic),
            ..plain
        })
    }

    /// Colour and exponent, if the illumination model has a highlight.
    fn highlight(&self) -> Option<(Vec3A, f32)> {
        let ks = self.ks.filter(|&ks| self.illum >= 2 && ks != Vec3A::ZERO)?;
        // Programs write an exponent of 0 where there is no highlight; as one, it is no cone at all.
        Some((ks, self.ns.filter(|&ns| ns > 0.0)?))
    }

    /// Black but for its highlight: a metal of the highlight's colour.
    fn mirror(&self) -> Option<Vec3A> {
        let black = self.kd == Some(Vec3A::ZERO) && self.map_kd.is_none();
        let (ks, _) = self.highlight()?;
        (black && self.pbr().is_none()).then_some(ks)
    }
}

fn normal_map(map: &Map, normals: TextureMap, report: &mut Report) -> Relief {
    if map.options.multiplier != 1.0 {
        report.note("option -bm of normal maps left out");
    }
    Relief::Normals(normals)
}

/// A clear body has no colour of its own, whatever the file says.
pub(super) fn make_dielectric(material: &mut Material, ior: f32) {
    material.scattering = Scattering::Dielectric { ior };
    material.color = Vec3A::ONE;
    material.color_texture = None;
    material.opacity = 1.0;
    material.opacity_texture = None;
}

#[cfg(test)]
mod tests;
