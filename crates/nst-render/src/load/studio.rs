//! Light for scenes that have none.
//!
//! A studio shows the form of what stands in it, whatever its colour: a lamp to the upper
//! left of the camera, and a weaker one above, to the right, both so near that even a flat
//! side is not of one brightness; a dim sky, so that no side is black; and a background that
//! only the camera sees, darker than what light bodies show on their dark sides, so that
//! they stand out all around. Its numbers were chosen by trying many, on twenty convex
//! bodies.

use std::{
    f64::consts::{PI, SQRT_2},
    fmt,
    str::FromStr,
    sync::Arc,
};

use glam::{DVec2, DVec3, Vec3A};

use crate::{Camera, Environment, Material, Texture, Triangle, scene::bounds};

/// Light that a scene is given, instead of an environment of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lighting {
    /// Two lamps beside the camera, a dim sky, and a grey background.
    Studio,
    /// A clear sky with a sun, and a ground.
    Sky,
    /// Radiance 1 from everywhere: a white furnace.
    White,
    /// Nothing.
    None,
}

impl Lighting {
    const ALL: [Self; 4] = [Self::Studio, Self::Sky, Self::White, Self::None];

    /// What it is, for a summary.
    pub(super) fn description(self) -> &'static str {
        match self {
            Self::Studio => "a studio (two lamps, of two triangles each)",
            Self::Sky => "a clear sky with a sun",
            Self::White => "a white environment",
            Self::None => "no light",
        }
    }
}

/// The name in TOML files and on the command line.
impl fmt::Display for Lighting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Studio => "studio",
            Self::Sky => "sky",
            Self::White => "white",
            Self::None => "none",
        })
    }
}

impl FromStr for Lighting {
    type Err = String;

    /// Undoes `to_string`.
    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|light| light.to_string() == name);
        let names = Self::ALL.map(|light| light.to_string()).join(", ");
        found.ok_or_else(|| format!("'{name}' is no light; there are {names}"))
    }
}

/// The largest component of the radiance that any triangle emits, textures apart.
pub(super) fn brightest(triangles: &[Triangle], materials: &[Material]) -> f32 {
    let emission = |triangle: &Triangle| materials[triangle.material as usize].emission;
    triangles.iter().map(|triangle| emission(triangle).max_element()).fold(0.0, f32::max)
}

/// The triangles and materials of a scene that is to be lit.
pub(super) struct Stage<'a> {
    pub(super) triangles: &'a mut Vec<Triangle>,
    pub(super) materials: &'a mut Vec<Material>,
    pub(super) camera: &'a Camera,
    /// The width of the picture divided by its height.
    pub(super) aspect: f64,
}

impl Stage<'_> {
    /// Adds the lamp, if there is one, and returns the environment.
    pub(super) fn light(&mut self, lighting: Lighting) -> Environment {
        match lighting {
            Lighting::Studio => {
                let (low, high) = bounds(self.triangles.iter());
                let (low, high) = (low.as_dvec3(), high.as_dvec3());
                let (middle, radius) = ((low + high) / 2.0, (high - low).length() / 2.0);
                LAMPS.iter().for_each(|lamp| self.add(lamp, middle, radius));
                studio()
            }
            Lighting::Sky => sky(),
            Lighting::White => Environment { radiance: Vec3A::ONE, ..Default::default() },
            Lighting::None => Environment::default(),
        }
    }

    /// A square lamp that faces the middle of the scene. If the picture would show it, it
    /// is further away, and brighter. Lengths are in units of the radius of the scene's
    /// bounding sphere. In f64, whose vectors give the same bits on every machine: the
    /// lamps are part of the scene's fingerprint.
    fn add(&mut self, lamp: &Lamp, middle: DVec3, radius: f64) {
        let [position, target, up] =
            [self.camera.position, self.camera.target, self.camera.up].map(|v| v.as_dvec3());
        let back = (position - target).normalize();
        let right = up.cross(back).normalize();
        let towards = DVec3::from(lamp.towards).normalize();
        let towards = right * towards.x + back.cross(right) * towards.y + back * towards.z;
        let mut distance = lamp.distance;
        let from_camera = |distance| towards * distance - (position - middle) / radius;
        while distance < FURTHEST && self.shows(from_camera(distance), back, lamp.size) {
            distance *= 1.25;
        }
        let centre = middle + towards * (distance * radius);
        let (across, along) = towards.any_orthonormal_pair();
        let [a, b, c, d] = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, y)| centre + (across * x + along * y) * (lamp.size * radius))
            .map(|corner| corner.as_vec3a());
        let material = self.materials.len() as u32;
        let triangle = |positions| Triangle { positions, normals: None, uvs: None, material };
        self.triangles.extend([triangle([a, b, c]), triangle([a, c, d])]);
        let side = 2.0 * lamp.size / distance;
        self.materials.push(Material {
            name: lamp.name.to_owned(),
            color: Vec3A::ZERO,
            emission: Vec3A::splat((lamp.light * PI / (side * side)) as f32),
            ..Material::default()
        });
    }

    /// Whether the picture may show a lamp; `centre` is its place, from the camera, and
    /// `back` the direction from which the camera looks.
    fn shows(&self, centre: DVec3, back: DVec3, size: f64) -> bool {
        let tangent = (f64::from(self.camera.vertical_fov).to_radians() / 2.0).tan();
        let corner = DVec2::new(tangent * self.aspect, tangent).length();
        let depth = -centre.dot(back);
        let across = (centre + back * depth).length();
        // From the centre to the corners of the lamp.
        let reach = size * SQRT_2;
        across - reach < (depth + reach) * corner
    }
}

/// A square lamp of the studio. Lengths are in units of the radius of the scene's bounding
/// sphere.
struct Lamp {
    name: &'static str,
    /// From the middle of the scene: along the camera's right, its up, and towards it.
    towards: [f64; 3],
    /// From the middle of the scene.
    distance: f64,
    /// Half the length of a side.
    size: f64,
    /// Radiance that a white surface reflects which faces it in the middle of the scene.
    light: f64,
}

const LAMPS: [Lamp; 2] = [
    Lamp {
        name: "studio: key light",
        towards: [-1.3, 1.0, 0.9],
        distance: 2.5,
        size: 0.5,
        light: 0.7,
    },
    Lamp {
        name: "studio: fill light",
        towards: [1.0, 1.5, -0.2],
        distance: 2.0,
        size: 0.3,
        light: 0.35,
    },
];
/// A lamp that would be in the picture from here on, too, stays there.
const FURTHEST: f64 = 100.0;
/// Radiance of the studio's sky from straight above and from straight below.
const SKY: [f32; 2] = [0.18, 0.17];
/// Radiance that the camera sees behind everything.
const BACKGROUND: f32 = 0.09;

fn studio() -> Environment {
    const ROWS: u32 = 16;
    let row = |y: u32| {
        let down = (y as f32 + 0.5) / ROWS as f32;
        [SKY[0] + (SKY[1] - SKY[0]) * down; 3]
    };
    Environment {
        radiance: Vec3A::ONE,
        image: Texture::new([1, ROWS], (0..ROWS).map(row).collect()).map(Arc::new),
        background: Some(Vec3A::splat(BACKGROUND)),
        rotation: 0.0,
    }
}

/// The colours of a clear sky at noon are those that photographs show, not measured: from
/// the zenith to the horizon, and the ground below it.
fn sky() -> Environment {
    const SIZE: [u32; 2] = [64, 32];
    let [zenith, horizon, ground] =
        [Vec3A::new(0.22, 0.42, 0.85), Vec3A::new(0.75, 0.85, 1.0), Vec3A::new(0.2, 0.18, 0.16)];
    let texel = |i: u32| {
        let [x, y] = [i % SIZE[0], i / SIZE[0]];
        if [x, y] == SUN {
            return SUN_RADIANCE;
        }
        let height = 1.0 - (y as f32 + 0.5) / (SIZE[1] as f32 / 2.0);
        let color = if height > 0.0 { horizon.lerp(zenith, height.sqrt()) } else { ground };
        color.to_array()
    };
    let texels = (0..SIZE[0] * SIZE[1]).map(texel).collect();
    Environment {
        radiance: Vec3A::ONE,
        image: Texture::new(SIZE, texels).map(Arc::new),
        ..Default::default()
    }
}

/// The texel of the sun: column 26 of 64 is between +z, where column 32 is, and +x; row 8
/// of 32 is 42 degrees above the horizon.
const SUN: [u32; 2] = [26, 8];
/// A texel of the sky is 200 times as large as the sun, whose light is about as strong as
/// that of the whole sky four times.
const SUN_RADIANCE: [f32; 3] = [420.0, 380.0, 320.0];
