//! What lies in the device's memory: a network's weights, and the lanes of a chunk.

use super::{
    Gpu,
    pack::{Packed, Params},
};
use crate::Error;

/// The most bytes that a kernel may read from one buffer.
pub(super) fn most_bytes(gpu: &Gpu) -> u64 {
    let limits = gpu.device.limits();
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
}

/// A network's layers and weights, as the kernels read them.
#[derive(Debug)]
pub(super) struct Weights {
    layers: wgpu::Buffer,
    weights: wgpu::Buffer,
    /// In f16, of the cooperative kernel.
    halves: Option<wgpu::Buffer>,
}

impl Weights {
    pub(super) fn upload(gpu: &Gpu, packed: &Packed) -> Result<Self, Error> {
        // Not `create_buffer_init`, which panics if the device is lost.
        let upload = |label, contents: &[u8]| {
            if contents.len() as u64 > most_bytes(gpu) {
                return Err(gpu.error(format!("its buffers are too small for the {label}")));
            }
            let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: contents.len() as u64,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            gpu.queue.write_buffer(&buffer, 0, contents);
            Ok(buffer)
        };
        Ok(Self {
            layers: upload("layers", bytemuck::cast_slice(&packed.layers))?,
            weights: upload("weights", &packed.weights)?,
            halves: packed.halves.as_ref().map(|halves| upload("weights", halves)).transpose()?,
        })
    }
}

/// The buffers of one chunk of lanes.
#[derive(Debug)]
pub(super) struct Buffers {
    /// The most that the buffers have room for.
    pub(super) lanes: usize,
    pub(super) params: wgpu::Buffer,
    /// `[term][lane]`.
    pub(super) terms: wgpu::Buffer,
    /// `[lane]`.
    pub(super) estimates: wgpu::Buffer,
    /// The same, where the CPU can read it.
    pub(super) staging: wgpu::Buffer,
    pub(super) bind_group: wgpu::BindGroup,
    /// What they are in use for.
    pub(super) submission: Option<wgpu::SubmissionIndex>,
}

impl Buffers {
    pub(super) fn new(
        gpu: &Gpu,
        pipeline: &wgpu::ComputePipeline,
        weights: &Weights,
        window: usize,
        lanes: usize,
    ) -> Self {
        use wgpu::BufferUsages as Usage;
        let buffer = |label, size: usize, usage| {
            gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size as u64,
                usage,
                mapped_at_creation: false,
            })
        };
        let bytes = lanes * size_of::<f32>();
        let params = buffer("params", size_of::<Params>(), Usage::UNIFORM | Usage::COPY_DST);
        let terms = buffer("terms", window * bytes, Usage::STORAGE | Usage::COPY_DST);
        let estimates =
            buffer("estimates", bytes, Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC);
        let staging = buffer("staging", bytes, Usage::MAP_READ | Usage::COPY_DST);
        let bound = [&params, &weights.layers, &weights.weights, &terms, &estimates];
        let entries: Vec<_> = (0_u32..)
            .zip(bound.into_iter().chain(&weights.halves))
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let bind_group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("mlp"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Self { lanes, params, terms, estimates, staging, bind_group, submission: None }
    }
}
