//! Unidirectional path tracing with next-event estimation (Kajiya 1986; multiple
//! importance sampling by the power heuristic, Veach 1997).
//!
//! Many paths grow side by side, vertex by vertex (Laine, Karras, Aila 2013), in
//! chunks of sixteen: so that one instruction does the same for several paths.
//! No path's numbers depend on its neighbours.

mod scatter;
mod wave;

use glam::{Vec2, Vec3, Vec3A};

use crate::{
    SampleStream, SamplerKind, Scattering, Scene,
    accelerator::{Accelerator, Hits, NONE, Stacks},
    bsdf::Prepared,
    instructions::{Instructions, Kernel, Vectors},
    lanes::LANES,
    light::Lights,
    scene::interpolate,
};
use scatter::Draws;
use wave::{Paths, Points, Queue};

/// Russian roulette may end a path from this vertex on.
const ROULETTE_START: u32 = 5;
/// The dimensions of a sample that belong to the camera.
const CAMERA_DIMENSIONS: u32 = 2;
/// A scene with everything that paths need.
pub(crate) struct PathTracer<'a> {
    scene: &'a Scene,
    accelerator: Accelerator,
    lights: Lights,
    /// By triangle.
    facets: Vec<Facet>,
    /// By material.
    scattering: Vec<Prepared>,
    /// [`Scene::scale`], for [`offset`].
    scale: f32,
    strategy: Strategy,
    instructions: Instructions,
}

/// What most hits need to know of a triangle.
#[repr(align(64))]
struct Facet {
    corners: [Vec3; 3],
    /// Unit geometric normal.
    normal: Vec3,
    material: u32,
    emits: bool,
    lambert: bool,
    smooth: bool,
    textured: bool,
}

/// Which samples count where lights and BSDF could both find the same light.
/// All strategies have the same expectation; tests compare them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Strategy {
    /// Both, weighted by the power heuristic.
    Both,
    #[cfg(test)]
    LightsOnly,
    #[cfg(test)]
    BsdfOnly,
}

impl<'a> PathTracer<'a> {
    pub(crate) fn new(scene: &'a Scene) -> Self {
        let facet = |triangle: &crate::Triangle| {
            let material = &scene.materials[triangle.material as usize];
            Facet {
                corners: triangle.positions.map(Vec3::from),
                normal: triangle.area_vector().normalize().into(),
                material: triangle.material,
                emits: material.emits(),
                lambert: matches!(material.scattering, Scattering::Lambert),
                smooth: triangle.normals.is_some(),
                textured: material.color_texture.is_some(),
            }
        };
        Self {
            scene,
            accelerator: Accelerator::new(&scene.triangles),
            lights: Lights::new(scene),
            facets: scene.triangles.iter().map(facet).collect(),
            scattering: scene.materials.iter().map(Prepared::new).collect(),
            scale: scene.scale(),
            strategy: Strategy::Both,
            instructions: Instructions::detect(),
        }
    }

    /// For each path, an unbiased estimate of the radiance that arrives at `origin`
    /// from its direction. The streams are those of one sampler, and have given
    /// nothing but the camera's dimensions so far.
    pub(crate) fn radiances<'w>(
        &self,
        workspace: &'w mut Workspace,
        sampler: SamplerKind,
        origin: Vec3A,
        directions: impl Iterator<Item = (Vec3A, SampleStream)>,
    ) -> &'w [Vec3A] {
        let mut count = 0;
        workspace.paths.clear();
        for (direction, stream) in directions {
            let (paths, i) = workspace.paths.push();
            paths.rays.origin.set(i, origin.into());
            paths.rays.direction.set(i, direction.into());
            paths.rays.tmax[i] = f32::INFINITY;
            paths.throughput.set(i, Vec3::ONE);
            paths.pdf[i] = f32::INFINITY;
            paths.streams.set(i, &stream);
            paths.path[i] = count;
            count += 1;
        }
        workspace.radiance.clear();
        workspace.radiance.resize(count as usize, Vec3A::ZERO);
        self.instructions.run(Trace { tracer: self, sampler, workspace });
        &workspace.radiance
    }
}

/// Memory that one batch of paths leaves to the next.
#[derive(Default)]
pub(crate) struct Workspace {
    paths: Queue<Paths>,
    /// Points of Lambert's surfaces, and of all others.
    queues: [Queue<Points>; 2],
    stacks: Stacks,
    /// By path.
    radiance: Vec<Vec3A>,
}

/// Follows paths to their ends.
struct Trace<'a> {
    tracer: &'a PathTracer<'a>,
    sampler: SamplerKind,
    workspace: &'a mut Workspace,
}

impl Kernel for Trace<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vectors>(self) {
        let Self { tracer, sampler, workspace } = self;
        let Workspace { paths, queues, stacks, radiance } = workspace;
        let mut dimension = CAMERA_DIMENSIONS;
        for vertex in 1..=tracer.scene.max_depth {
            let is_last = vertex == tracer.scene.max_depth;
            for paths in paths.chunks() {
                let mut hits = Hits::MISSED;
                tracer.accelerator.nearest::<V>(&paths.rays, stacks, &mut hits);
                for i in (0..LANES).filter(|&i| paths.rays.tmax[i] >= 0.0) {
                    radiance[paths.path[i] as usize] += tracer.emitted(paths, &hits, i);
                    if hits.triangle[i] != NONE && !is_last {
                        tracer.arrive(paths, &hits, i, queues);
                    }
                }
            }
            paths.clear();
            let roulette = tracer.scene.russian_roulette && vertex >= ROULETTE_START;
            for (queue, are_lambert) in queues.iter_mut().zip([true, false]) {
                for points in queue.chunks() {
                    let draws = Draws::new(points, sampler, dimension, roulette);
                    let mut direct = tracer.lights(points, &draws);
                    let next: &mut Paths = paths.push_chunk();
                    next.streams = points.streams;
                    next.path = points.path;
                    if are_lambert {
                        tracer.reflect(points, &draws, &mut direct, next);
                    } else {
                        tracer.scatter(points, &draws, &mut direct, next);
                    }
                    scatter::survive(&draws, next);
                    let rays = &direct.lights.rays;
                    let hidden = tracer.accelerator.hides::<V>(rays, stacks);
                    for i in (0..LANES).filter(|&i| rays.tmax[i] >= 0.0 && !hidden[i]) {
                        let contribution = Vec3A::from(direct.contribution.get(i));
                        radiance[points.path[i] as usize] += contribution;
                    }
                }
                queue.clear();
            }
            if paths.chunks().is_empty() {
                break;
            }
            dimension += Draws::dimensions(roulette);
        }
    }
}

impl PathTracer<'_> {
    /// The weighted light of what a path has come to: a light, the environment, or none.
    #[inline(always)]
    fn emitted(&self, paths: &Paths, hits: &Hits, lane: usize) -> Vec3A {
        let direction = Vec3A::from(paths.rays.direction.get(lane));
        let (radiance, pdf_light) = if hits.triangle[lane] == NONE {
            (self.scene.environment.radiance(direction), self.lights.pdf_escape(direction))
        } else {
            let index = hits.triangle[lane] as usize;
            if !self.facets[index].emits {
                return Vec3A::ZERO;
            }
            let triangle = &self.scene.triangles[index];
            let cosine = direction.dot(self.facets[index].normal.into());
            let barycentric = Vec2::new(hits.u[lane], hits.v[lane]);
            (
                self.scene.emission(triangle, barycentric),
                self.lights.pdf_hit(triangle, hits.t[lane], cosine),
            )
        };
        let weight = self.weight_bsdf(paths.pdf[lane], pdf_light);
        Vec3A::from(paths.throughput.get(lane)) * radiance * weight
    }

    /// Puts a path that has hit a surface into the queue for its material.
    #[inline(always)]
    fn arrive(&self, paths: &Paths, hits: &Hits, lane: usize, queues: &mut [Queue<Points>; 2]) {
        let index = hits.triangle[lane];
        let facet = &self.facets[index as usize];
        let barycentric = Vec2::new(hits.u[lane], hits.v[lane]);
        let direction = paths.rays.direction.get(lane);
        let (points, i) = queues[usize::from(!facet.lambert)].push();
        // The position comes from the corners, not along the ray: its error is
        // then that of the surface's coordinates, however far the ray has come.
        points.position.set(i, interpolate(facet.corners, barycentric));
        points.normal.set(i, facet.normal);
        let shading = if facet.smooth {
            self.smooth_normal(index, barycentric, direction)
        } else {
            facet.normal
        };
        points.shading.set(i, shading);
        points.wo.set(i, -direction);
        let color = if facet.textured {
            self.scene.color(&self.scene.triangles[index as usize], barycentric)
        } else {
            self.scene.materials[facet.material as usize].color
        };
        points.color.set(i, color.into());
        points.throughput.set(i, paths.throughput.get(lane));
        points.streams.copy(i, &paths.streams, lane);
        points.path[i] = paths.path[lane];
        points.triangle[i] = index;
    }

    fn smooth_normal(&self, triangle: u32, barycentric: Vec2, direction: Vec3) -> Vec3 {
        let normal = self.facets[triangle as usize].normal;
        let Some(normals) = self.scene.triangles[triangle as usize].normals else { return normal };
        let smooth = Vec3::from(interpolate(normals, barycentric)).normalize_or(normal);
        let smooth = if smooth.dot(normal) < 0.0 { -smooth } else { smooth };
        // At a silhouette, a smooth normal may face away from who looks at the
        // surface; the geometric one never does.
        if smooth.dot(direction) * normal.dot(direction) > 0.0 { smooth } else { normal }
    }

    /// The weight of a light that a BSDF sample found.
    fn weight_bsdf(&self, pdf_bsdf: f32, pdf_light: f32) -> f32 {
        match self.strategy {
            _ if pdf_bsdf == f32::INFINITY => 1.0,
            Strategy::Both => power_heuristic(pdf_bsdf, pdf_light),
            #[cfg(test)]
            Strategy::LightsOnly => {
                if pdf_light > 0.0 {
                    0.0
                } else {
                    1.0
                }
            }
            #[cfg(test)]
            Strategy::BsdfOnly => 1.0,
        }
    }

    /// The weight of a light sample.
    #[inline(always)]
    fn weight_light(&self, pdf_light: f32, pdf_bsdf: f32) -> f32 {
        match self.strategy {
            Strategy::Both => power_heuristic(pdf_light, pdf_bsdf),
            #[cfg(test)]
            Strategy::LightsOnly => 1.0,
            #[cfg(test)]
            Strategy::BsdfOnly => 0.0,
        }
    }
}

/// The weight of a sample with density `pdf` beside a technique with density `other`.
#[inline(always)]
fn power_heuristic(pdf: f32, other: f32) -> f32 {
    // Divided through by pdf², which may overflow when squared near a light.
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use std::{path::Path, sync::Arc};

    use glam::Vec2;

    use super::*;
    use crate::{Environment, Sampler, SamplerKind, Texture, camera::Projection};

    fn scene(name: &str) -> Scene {
        let path = format!("{}/../../scenes/{name}/{name}.obj", env!("CARGO_MANIFEST_DIR"));
        Scene::load(Path::new(&path)).expect("the scene is part of the repository")
    }

    /// The mean radiance over a film of 4 × 4 pixels, and its variance.
    fn mean(scene: &Scene, strategy: Strategy, seed: u64) -> (f64, f64) {
        const COUNT: u32 = 20_000;
        let tracer = PathTracer { strategy, ..PathTracer::new(scene) };
        let projection = Projection::new(&scene.camera, [4, 4]);
        let sampler = Sampler::new(SamplerKind::Random, seed);
        let camera = |i: u32| {
            let mut samples = sampler.stream(i % 16, i / 16);
            let film = Vec2::new((i % 4) as f32, (i / 4 % 4) as f32) + samples.next_2d();
            (projection.direction(film), samples)
        };
        let mut workspace = Workspace::default();
        let rays = (0..COUNT).map(camera);
        let radiances =
            tracer.radiances(&mut workspace, SamplerKind::Random, projection.origin, rays);
        let (mut sum, mut squares) = (0.0, 0.0);
        for radiance in radiances {
            let value = f64::from(radiance.element_sum());
            sum += value;
            squares += value * value;
        }
        let n = f64::from(COUNT);
        (sum / n, (squares / n - (sum / n).powi(2)) / n)
    }

    /// |z| of the difference between two estimates of a mean.
    fn z((a, va): (f64, f64), (b, vb): (f64, f64)) -> f64 {
        (a - b).abs() / (va + vb).sqrt()
    }

    fn assert_strategies_agree(name: &str, scene: &Scene) {
        let both = mean(scene, Strategy::Both, 1);
        for (seed, strategy) in [(2, Strategy::LightsOnly), (3, Strategy::BsdfOnly)] {
            let other = mean(scene, strategy, seed);
            assert!(z(both, other) < 4.0, "{name}: {both:?}, {strategy:?}: {other:?}");
        }
        // More precise than the difference that one missing bounce makes.
        let fewer = Scene { max_depth: scene.max_depth - 1, ..scene.clone() };
        assert!(z(both, mean(&fewer, Strategy::Both, 4)) > 4.0, "{name}");
    }

    /// The radiances of a few thousand paths of a scene.
    fn radiances(tracer: &PathTracer<'_>) -> Vec<Vec3A> {
        let projection = Projection::new(&tracer.scene.camera, [64, 64]);
        let sampler = Sampler::new(SamplerKind::Random, 7);
        let paths = (0..64 * 64_u32).map(|i| {
            let mut samples = sampler.stream(i, 0);
            let film = Vec2::new((i % 64) as f32, (i / 64) as f32) + samples.next_2d();
            (projection.direction(film), samples)
        });
        let mut workspace = Workspace::default();
        tracer.radiances(&mut workspace, SamplerKind::Random, projection.origin, paths).to_vec()
    }

    #[test]
    fn all_instructions_give_the_same_bits() {
        for name in ["cornell", "teapot-glossy", "caustic"] {
            let scene = scene(name);
            let with =
                |instructions| radiances(&PathTracer { instructions, ..PathTracer::new(&scene) });
            let portable = with(Instructions::Portable);
            assert!(portable.iter().any(|radiance| *radiance != Vec3A::ZERO));
            for instructions in Instructions::available() {
                assert!(with(instructions) == portable, "{name}, {instructions:?}");
            }
        }
    }

    /// The oracle: every surface scatters one path at a time. Rounding differs, and
    /// where it sends a path past an edge, all that follows does; so rarely.
    #[test]
    fn paths_side_by_side_are_those_one_by_one() {
        for name in ["cornell", "teapot-diffuse", "many-lights"] {
            let scene = scene(name);
            let together = radiances(&PathTracer::new(&scene));
            let others = |scene: &Scene| {
                let mut tracer = PathTracer::new(scene);
                tracer.facets.iter_mut().for_each(|facet| facet.lambert = false);
                let one_by_one = radiances(&tracer);
                let differ = |(a, b): &(&Vec3A, &Vec3A)| !a.abs_diff_eq(**b, 1e-3 * a.length());
                together.iter().zip(&one_by_one).filter(differ).count()
            };
            let few = together.len() / 200;
            assert!(others(&scene) < few, "{name}: {}", others(&scene));
            let fewer = Scene { max_depth: scene.max_depth - 1, ..scene.clone() };
            assert!(others(&fewer) > few, "{name}");
        }
    }

    #[test]
    fn lights_and_bsdf_alone_agree_with_both() {
        for name in ["plane-lambert", "plane-ggx", "teapot-glossy"] {
            assert_strategies_agree(name, &scene(name));
        }
        let direct = Scene { max_depth: 2, ..scene("cornell") };
        assert_strategies_agree("cornell", &direct);
    }

    #[test]
    fn they_agree_under_an_image_of_the_sky() {
        let texel = |i: usize| if i == 90 { [30.0, 20.0, 10.0] } else { [0.2, 0.3, 0.4] };
        let sky = Texture::new([16, 8], (0..128).map(texel).collect()).expect("128 texels");
        let mut scene = scene("teapot-glossy");
        scene.environment = Environment { radiance: Vec3A::ONE, image: Some(Arc::new(sky)) };
        assert_strategies_agree("sky and lamp", &scene);
        for material in &mut scene.materials {
            material.emission = Vec3A::ZERO;
        }
        assert_strategies_agree("sky alone", &scene);
    }

    #[test]
    fn russian_roulette_keeps_the_mean() {
        let with = scene("cornell");
        let without = Scene { russian_roulette: false, ..with.clone() };
        assert!(with.max_depth > ROULETTE_START);
        let z = z(mean(&with, Strategy::Both, 5), mean(&without, Strategy::Both, 6));
        assert!(z < 4.0, "{z}");
    }
}
