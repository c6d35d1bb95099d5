//! Unidirectional path tracing with next-event estimation (Kajiya 1986; multiple
//! importance sampling by the power heuristic, Veach 1997).
//!
//! Many paths grow side by side, vertex by vertex (Laine, Karras, Aila 2013), in
//! packets of sixteen, so that one instruction does the same for several paths.
//! No path's numbers depend on its neighbours.

mod arrive;
mod cut_outs;
mod features;
mod relief;
mod scatter;
mod tracer;
mod wave;

use glam::{Vec3, Vec3A};

use crate::{
    SampleStream, SamplerKind,
    accelerator::{Hits, NONE, Stacks},
    instructions::{Kernel, Vectors},
    packet::PACKET,
};
use scatter::Draws;
use wave::{Paths, Points, Queue};

#[cfg(test)]
pub(crate) use features::FeatureSample;
pub(crate) use {features::FeaturePacket, tracer::PathTracer};

/// Russian roulette may end a path from this vertex on: shorter paths carry most of the
/// light.
const ROULETTE_START: u32 = 5;
/// The dimensions of a sample that belong to the camera.
const CAMERA_DIMENSIONS: u32 = 2;

impl PathTracer<'_> {
    /// For each path, an unbiased estimate of the radiance that arrives at `origin`
    /// from its direction. The streams are those of one sampler, and nothing has been
    /// drawn from them but the camera's dimensions.
    #[cfg(test)]
    pub(crate) fn radiances<'w>(
        &self,
        workspace: &'w mut Workspace,
        sampler: SamplerKind,
        origin: Vec3A,
        directions: impl Iterator<Item = (Vec3A, SampleStream)>,
    ) -> &'w [Vec3A] {
        self.trace::<false>(workspace, sampler, origin, directions).0
    }

    /// For each path, an unbiased estimate of the radiance that arrives at `origin`
    /// from its direction, and its features if they are wanted, in packets in the same order.
    /// The streams are those of one sampler, and nothing has been drawn from them but the
    /// camera's dimensions.
    pub(crate) fn trace<'w, const FEATURES: bool>(
        &self,
        workspace: &'w mut Workspace,
        sampler: SamplerKind,
        origin: Vec3A,
        directions: impl Iterator<Item = (Vec3A, SampleStream)>,
    ) -> (&'w [Vec3A], &'w mut [FeaturePacket]) {
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
        let packets = if FEATURES { workspace.paths.packets().len() } else { 0 };
        // Without those of other paths, which the first vertex overwrites.
        workspace.features.resize(packets, FeaturePacket::NONE);
        self.instructions.run(Trace::<FEATURES> { tracer: self, sampler, workspace });
        (&workspace.radiance, &mut workspace.features)
    }
}

/// Memory that is used for one batch of paths after the other.
#[derive(Default)]
pub(crate) struct Workspace {
    paths: Queue<Paths>,
    /// Points of Lambert's surfaces, and of all others.
    queues: [Queue<Points>; 2],
    stacks: Stacks,
    /// Radiance by path, in the order of [`PathTracer::trace`].
    radiance: Vec<Vec3A>,
    /// Features by path, in the same order; none if they are not wanted.
    features: Vec<FeaturePacket>,
}

/// Follows paths to their ends.
struct Trace<'a, const FEATURES: bool> {
    tracer: &'a PathTracer<'a>,
    sampler: SamplerKind,
    workspace: &'a mut Workspace,
}

impl<const FEATURES: bool> Kernel for Trace<'_, FEATURES> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vectors>(self, vectors: V) {
        let Self { tracer, sampler, workspace } = self;
        let Workspace { paths, queues, stacks, radiance, features } = workspace;
        let mut dimension = CAMERA_DIMENSIONS;
        for vertex in 1..=tracer.scene.max_depth {
            let is_last = vertex == tracer.scene.max_depth;
            for (number, paths) in paths.packets().iter().enumerate() {
                let mut hits = Hits::MISSED;
                if tracer.has_cut_outs {
                    hits = tracer.see_through(&paths.rays, &paths.streams, dimension, stacks);
                } else {
                    tracer.accelerator.nearest(vectors, &paths.rays, stacks, &mut hits);
                }
                for i in (0..PACKET).filter(|&i| paths.rays.tmax[i] >= 0.0) {
                    let emitted = tracer.emitted(paths, &hits, i, vertex == 1);
                    radiance[paths.path[i] as usize] += emitted;
                    if hits.triangle[i] != NONE && !is_last {
                        let surface = tracer.surface(paths, &hits, i);
                        tracer.arrive(paths, &hits, i, &surface, queues);
                    }
                }
                if FEATURES && vertex == 1 {
                    // The paths are in their order still.
                    tracer.see_first(&mut features[number], paths, &hits, radiance, is_last);
                } else if FEATURES && tracer.has_mirrors {
                    tracer.see(features, paths, &hits);
                }
            }
            paths.clear();
            let roulette = tracer.scene.russian_roulette && vertex >= ROULETTE_START;
            for (queue, are_lambert) in queues.iter_mut().zip([true, false]) {
                for points in queue.packets() {
                    if FEATURES && vertex == 1 {
                        tracer.see_points(points, are_lambert, features);
                    }
                    let draws = Draws::new(points, sampler, dimension, roulette);
                    let mut direct = tracer.lights(points, &draws);
                    let next: &mut Paths = paths.push_packet();
                    next.streams = points.streams;
                    next.path = points.path;
                    if are_lambert {
                        tracer.reflect(points, &draws, &mut direct, next);
                    } else {
                        tracer.scatter(points, &draws, &mut direct, next);
                    }
                    scatter::survive(&draws, next);
                    let rays = &direct.lights.rays;
                    let hidden = if tracer.has_cut_outs {
                        let hits = tracer.see_through(rays, &points.streams, dimension + 1, stacks);
                        hits.triangle.map(|triangle| triangle != NONE)
                    } else {
                        tracer.accelerator.hides(vectors, rays, stacks)
                    };
                    for i in (0..PACKET).filter(|&i| rays.tmax[i] >= 0.0 && !hidden[i]) {
                        let contribution = Vec3A::from(direct.contribution.get(i));
                        radiance[points.path[i] as usize] += contribution;
                    }
                }
                queue.clear();
            }
            if paths.packets().is_empty() {
                break;
            }
            dimension += Draws::dimensions(roulette);
        }
    }
}

#[cfg(test)]
mod tests;
