//! Materials from an MTL file; `docs/scenes.md` has the table of keys.

use std::{
    ops::RangeInclusive,
    path::{Path, PathBuf},
};

use glam::Vec3A;

use super::{
    exact::fourth_root,
    files::{find, without_options},
    image::Images,
    ranges::{FINITE, IOR, NOT_NEGATIVE, RADIANCE, UNIT},
    report::Report,
    text::{self, Line, error_at, number_within, quoted},
};
use crate::{Disney, Error, Material, Scattering};

/// Reflectance of a material that says nothing about it.
const DEFAULT_COLOR: f32 = 0.8;
/// Index of refraction of a transparent material that does not say: glass.
const DEFAULT_IOR: f32 = 1.5;

/// Keys that change the look of a surface, but that nothing here reads.
const NOTED: [&str; 13] = [
    "map_d", "map_tr", "map_pr", "map_pm", "map_ps", "map_ks", "map_ns", "map_bump", "bump",
    "norm", "disp", "decal", "refl",
];

/// What a material's statements say, in the file's own terms.
#[derive(Default)]
struct Statements {
    name: String,
    kd: Option<Vec3A>,
    ks: Option<Vec3A>,
    ke: Option<Vec3A>,
    ns: Option<f32>,
    /// With its line, as its range depends on other statements.
    ni: Option<(usize, f32)>,
    /// Opacity.
    d: Option<f32>,
    /// One minus opacity; `d` takes precedence.
    tr: Option<f32>,
    illum: u32,
    pr: Option<f32>,
    pm: Option<f32>,
    ps: Option<f32>,
    pc: Option<f32>,
    pcr: Option<f32>,
    aniso: Option<f32>,
    map_kd: Option<PathBuf>,
    map_ke: Option<PathBuf>,
}

/// Reads the materials of an MTL file.
///
/// # Errors
/// Names the line, the material and the key that is malformed; or the image.
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
                return Err(line.error(path, "newmtl without a name"));
            }
            all.push(Statements { name: line.name().to_owned(), ..Default::default() });
        } else if let Some(statements) = all.last_mut() {
            statements.read(path, &key, &line, report).map_err(|message| {
                let name = quoted(&statements.name);
                line.error(path, format!("material {name}: {message}"))
            })?;
            if NOTED.contains(&key.as_str()) {
                report.note(format!("{} left out", line.keyword()));
            }
        } else {
            let message = format!("{} before the first newmtl", quoted(line.keyword()));
            return Err(line.error(path, message));
        }
    }
    all.into_iter().map(|statements| statements.material(path, images, report)).collect()
}

impl Statements {
    /// Reads a statement. Keys that are not in the list are left out: there is no end
    /// of them, and [`NOTED`] has those that one would miss.
    fn read(
        &mut self,
        path: &Path,
        key: &str,
        line: &Line,
        report: &mut Report,
    ) -> Result<(), String> {
        let number = |range| {
            let word = line.words().find(|&word| word != "-halo");
            let word = word.ok_or_else(|| format!("{} without a number", line.keyword()))?;
            number_within(line.keyword(), word, &range)
        };
        match key {
            "kd" => self.kd = Some(color(line, &UNIT)?),
            "ks" => self.ks = Some(color(line, &UNIT)?),
            "ke" => self.ke = Some(color(line, &RADIANCE)?),
            "ns" => self.ns = Some(number(NOT_NEGATIVE)?),
            "ni" => self.ni = Some((line.number, number(FINITE)?)),
            "d" => self.d = Some(number(UNIT)?),
            "tr" => self.tr = Some(number(UNIT)?),
            "illum" => self.illum = number(0.0..=10.0)? as u32,
            "pr" => self.pr = Some(number(UNIT)?),
            "pm" => self.pm = Some(number(UNIT)?),
            "ps" => self.ps = Some(number(UNIT)?),
            "pc" => self.pc = Some(number(UNIT)?),
            "pcr" => self.pcr = Some(number(UNIT)?),
            "aniso" => self.aniso = Some(number(UNIT)?),
            "map_kd" => self.map_kd = Some(image_file(path, line, report)?),
            "map_ke" => self.map_ke = Some(image_file(path, line, report)?),
            _ => {}
        }
        Ok(())
    }

    fn material(
        self,
        path: &Path,
        images: &mut Images,
        report: &mut Report,
    ) -> Result<Material, Error> {
        let scattering = self.scattering(path)?;
        // Black times a texture is what some exporters write, but nobody means.
        let tint = |color: Option<Vec3A>, texture: &Option<PathBuf>| match texture {
            Some(_) => Some(color.filter(|&color| color != Vec3A::ZERO).unwrap_or(Vec3A::ONE)),
            None => color,
        };
        let mut material = Material {
            color: tint(self.kd, &self.map_kd).unwrap_or(Vec3A::splat(DEFAULT_COLOR)),
            color_texture: match &self.map_kd {
                Some(file) => Some(images.reflectance(file, report)?),
                None => None,
            },
            emission: tint(self.ke, &self.map_ke).unwrap_or(Vec3A::ZERO),
            emission_texture: match &self.map_ke {
                Some(file) => Some(images.radiance(file, report)?),
                None => None,
            },
            scattering,
            name: self.name.clone(),
        };
        if let Scattering::Dielectric { ior } = scattering {
            make_dielectric(&mut material, ior);
        } else if let Some(ks) = self.mirror() {
            material.color = ks;
        }
        Ok(material)
    }

    fn scattering(&self, path: &Path) -> Result<Scattering, Error> {
        if self.is_transparent() {
            let (line, ior) = self.ni.unwrap_or((0, DEFAULT_IOR));
            if !IOR.contains(&ior) {
                let (name, least, most) = (quoted(&self.name), IOR.start(), IOR.end());
                let rule = format!("of a transparent material is not within {least} and {most}");
                return Err(error_at(path, line, format!("material {name}: Ni {ior} {rule}")));
            }
            return Ok(Scattering::Dielectric { ior });
        }
        if let Some(disney) = self.pbr() {
            return Ok(Scattering::Disney(disney));
        }
        let Some((ks, ns)) = self.highlight() else { return Ok(Scattering::Lambert) };
        Ok(Scattering::Disney(Disney {
            specular: ks.max_element(),
            // α² = 2 / (Ns + 2), where α = roughness².
            roughness: fourth_root(2.0 / (ns + 2.0)),
            metallic: if self.mirror().is_some() { 1.0 } else { 0.0 },
            ..Default::default()
        }))
    }

    fn is_transparent(&self) -> bool {
        let opacity = self.d.unwrap_or(1.0 - self.tr.unwrap_or(0.0));
        opacity < 1.0 || matches!(self.illum, 4 | 6 | 7 | 9)
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
        Some((ks, self.ns?))
    }

    /// Black but for its highlight: a metal of the highlight's colour.
    fn mirror(&self) -> Option<Vec3A> {
        let black = self.kd == Some(Vec3A::ZERO) && self.map_kd.is_none();
        let (ks, _) = self.highlight()?;
        (black && self.pbr().is_none()).then_some(ks)
    }
}

/// A clear body has no colour of its own, whatever the file says.
pub(super) fn make_dielectric(material: &mut Material, ior: f32) {
    material.scattering = Scattering::Dielectric { ior };
    material.color = Vec3A::ONE;
    material.color_texture = None;
}

/// One number for grey, or three.
fn color(line: &Line, range: &RangeInclusive<f32>) -> Result<Vec3A, String> {
    let mut rgb = [0.0; 3];
    let mut count = 0;
    for (channel, word) in rgb.iter_mut().zip(line.words()) {
        *channel = number_within(line.keyword(), word, range)?;
        count += 1;
    }
    match count {
        1 => Ok(Vec3A::splat(rgb[0])),
        3 => Ok(rgb.into()),
        _ => Err(format!("{} is of {count} numbers instead of three", line.keyword())),
    }
}

/// The file that `map_Kd -options FILE` names.
fn image_file(mtl: &Path, line: &Line, report: &mut Report) -> Result<PathBuf, String> {
    let name = without_options(line.name());
    let options = line.name()[..line.name().len() - name.len()].trim_end();
    let name = name.trim_matches('"');
    if name.is_empty() {
        return Err(format!("{} names no file", line.keyword()));
    }
    if !options.is_empty() {
        report.note(format!("options {} of {} left out", quoted(options), line.keyword()));
    }
    let file = find(mtl, name, report);
    match std::fs::metadata(&file) {
        Ok(_) => Ok(file),
        Err(error) => Err(format!("{}: cannot read '{}': {error}", line.keyword(), file.display())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(text: &str) -> Result<Vec<Material>, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.mtl");
        std::fs::write(&path, text).expect("a file");
        image::RgbImage::new(1, 1).save(folder.path().join("a b.png")).expect("an image");
        super::load(&path, &mut Images::default(), &mut Report::default())
            .map_err(|error| error.to_string())
    }

    fn material(statements: &str) -> Material {
        let materials = load(&format!("newmtl m\n{statements}")).expect("good statements");
        materials.into_iter().next().expect("one material")
    }

    fn disney(statements: &str) -> Disney {
        match material(statements).scattering {
            Scattering::Disney(disney) => disney,
            other => panic!("{statements}: {other:?}"),
        }
    }

    #[test]
    fn colours_and_emission() {
        let m = material("kd .1 .2 .3\nKe 4\nKa 9 9 9\nmap_Bump gone.png");
        assert_eq!(m.color, Vec3A::new(0.1, 0.2, 0.3));
        assert_eq!((m.emission, m.scattering), (Vec3A::splat(4.0), Scattering::Lambert));
        assert_eq!(material("").color, Vec3A::splat(DEFAULT_COLOR));
    }

    #[test]
    fn textures_are_multiplied_by_what_is_not_black() {
        let names = ["a b.png", "-s 1 1 1 a b.png", "-o .5 -clamp on a b.png", "C:\\x\\a b.png"];
        for name in names {
            let m = material(&format!("Kd 0 0 0\nmap_Kd {name}"));
            assert!(m.color_texture.is_some());
            assert_eq!(m.color, Vec3A::ONE);
        }
        assert_eq!(material("map_Kd a b.png\nKd .5").color, Vec3A::splat(0.5));
        let m = material("map_Ke a b.png");
        assert!(m.emits() && m.emission_texture.is_some());
        assert_eq!(m.color, Vec3A::splat(DEFAULT_COLOR));
    }

    #[test]
    fn physical_keys_make_a_disney_material() {
        let all = disney("Pr .1\nPm .2\nPs .3\nPc .4\nPcr .75\naniso .6\nNs 9\nKs 1\nillum 2");
        let expected = Disney {
            roughness: 0.1,
            metallic: 0.2,
            sheen: 0.3,
            clearcoat: 0.4,
            clearcoat_gloss: 0.25,
            anisotropic: 0.6,
            ..Default::default()
        };
        assert_eq!(all, expected);
        assert_eq!(disney("Pm 1"), Disney { metallic: 1.0, ..Default::default() });
    }

    #[test]
    fn highlights_make_a_disney_material() {
        let plastic = disney("Kd .5\nKs .2 .4 .3\nNs 30\nillum 2");
        assert_eq!((plastic.specular, plastic.roughness, plastic.metallic), (0.4, 0.5, 0.0));
        let metal = material("Kd 0 0 0\nKs .9 .8 .1\nNs 30\nillum 3");
        assert_eq!(metal.color, Vec3A::new(0.9, 0.8, 0.1));
        assert!(matches!(metal.scattering, Scattering::Disney(Disney { metallic: 1.0, .. })));
        for matte in ["Ks 1\nillum 2", "Ks 1\nNs 9", "Ks 0\nNs 9\nillum 2"] {
            assert_eq!(material(matte).scattering, Scattering::Lambert, "{matte}");
        }
    }

    #[test]
    fn transparency_makes_a_dielectric() {
        let ior = |statements: &str| match material(statements).scattering {
            Scattering::Dielectric { ior } => Some(ior),
            _ => None,
        };
        assert_eq!(ior("illum 7\nNi 1.33"), Some(1.33));
        assert_eq!(ior("d .5"), Some(1.5));
        assert_eq!(ior("d -halo .5"), Some(1.5));
        assert_eq!(ior("Tr .5\nPr .3"), Some(1.5));
        assert_eq!(ior("Tr 1\nd 1"), None);
        assert_eq!(ior("Ni 0"), None);
        assert_eq!(material("illum 4\nKd 0 0 0").color, Vec3A::ONE);
    }

    #[test]
    fn errors_name_line_material_and_key() {
        let cases = [
            ("Kd 2 0 0", "Kd '2' is not within 0 and 1"),
            ("Kd 0 0", "Kd is of 2 numbers"),
            ("Kd", "Kd is of 0 numbers"),
            ("Kd red", "Kd 'red' is not a number"),
            ("Kd spectral x.rfl", "Kd 'spectral'"),
            ("Ke -1 0 0", "Ke '-1' is not within 0 and"),
            ("Ke 1e39", "Ke '1e39' is not finite"),
            ("Ns", "Ns without a number"),
            ("Ns -5", "Ns '-5'"),
            ("Pr 1.5", "Pr '1.5' is not within 0 and 1"),
            ("d nan", "d 'nan' is not finite"),
            ("illum 11", "illum '11'"),
            ("Ni 0\nd .5", "Ni 0 of a transparent"),
            ("map_Kd", "map_Kd names no file"),
            ("map_Kd -s 1 1 1", "map_Kd names no file"),
            ("map_Kd gone.png", "gone.png"),
        ];
        for (statements, words) in cases {
            let error = load(&format!("# a file\nnewmtl m\n{statements}")).expect_err(statements);
            let complete = error.contains("x.mtl") && error.contains("line 3: material 'm': ");
            assert!(complete && error.contains(words), "{statements}: {error}");
        }
        assert!(load("Kd 1 1 1").expect_err("no name").contains("line 1: 'Kd' before"));
        assert!(load("newmtl").expect_err("no name").contains("line 1: newmtl without"));
    }
}
