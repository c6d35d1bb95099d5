//! The network as a compute shader: see `mlp.wgsl`.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use ndarray::ArrayView2;
use wgpu::util::DeviceExt;

use super::Gpu;
use crate::{Error, Estimates, Layer, Network, SequenceBatch, Status, Transform, transform::Active};

const SHADER: &str = include_str!("mlp.wgsl");

/// `THREADS` of the shader: blocks of four neurons, so no layer may be wider than 256.
const THREADS: u32 = 64;
/// `LANES_PER_GROUP` of the shader.
const LANES_PER_GROUP: u32 = 16;
/// Lanes per submission where the adapter sets no lower limit: 32 MiB of terms at window 8.
const MAX_CHUNK: u64 = 1 << 20;

/// `Params` of the shader.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Params {
    lanes: u32,
    window: u32,
    layers: u32,
    negative_slope: f32,
}

/// `Layer` of the shader.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct LayerTable {
    inputs: u32,
    blocks: u32,
    weights: u32,
    biases: u32,
}

/// Evaluates a [`Network`] in a WGSL compute shader; lanes stream through the
/// device in chunks, so that no buffer limit bounds the size of a batch.
#[derive(Debug)]
pub struct MlpGpu {
    gpu: Gpu,
    network: Arc<Network>,
    pipeline: wgpu::ComputePipeline,
    layers: wgpu::Buffer,
    weights: wgpu::Buffer,
    lanes_per_workgroup: u32,
    max_chunk: u32,
}

impl MlpGpu {
    /// Compiles the shader and uploads the weights.
    ///
    /// # Errors
    /// [`Error::Gpu`] if a layer is wider than 256 or if the device refuses the shader.
    pub fn new(gpu: Gpu, network: impl Into<Arc<Network>>) -> Result<Self, Error> {
        let network = network.into();
        let window = network.metadata().window;
        let widest = network.layers().iter().map(Layer::outputs).fold(window, usize::max);
        let blocks = (widest as u32).div_ceil(4).next_power_of_two();
        if blocks > THREADS {
            return Err(Error::Gpu(format!(
                "the network is {widest} wide; the shader takes up to {}",
                4 * THREADS
            )));
        }
        let lanes_per_workgroup = LANES_PER_GROUP * THREADS / blocks;

        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("mlp"),
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("mlp"),
            layout: None,
            module: &module,
            entry_point: Some("transform"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &[("BLOCKS", f64::from(blocks))],
                ..Default::default()
            },
            cache: None,
        });
        let (table, packed) = pack(&network);
        let upload = |label, contents| {
            device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents,
                usage: wgpu::BufferUsages::STORAGE,
            })
        };
        let layers = upload("layers", bytemuck::cast_slice(&table));
        let weights = upload("weights", bytemuck::cast_slice(&packed));
        gpu.check()?;

        let limits = device.limits();
        let bytes_per_lane = (window * size_of::<f32>()) as u64;
        let workgroups = u64::from(limits.max_compute_workgroups_per_dimension);
        let max_chunk = MAX_CHUNK
            .min(limits.max_storage_buffer_binding_size / bytes_per_lane)
            .min(limits.max_buffer_size / bytes_per_lane)
            .min(workgroups * u64::from(lanes_per_workgroup)) as u32;
        if max_chunk == 0 {
            return Err(Error::Gpu(format!("{}: its buffers are too small", gpu.name)));
        }
        Ok(Self { gpu, network, pipeline, layers, weights, lanes_per_workgroup, max_chunk })
    }

    /// Evaluates the network on a chunk of lanes, `[term][lane]`.
    fn run_chunk(
        &self,
        buffers: &Buffers,
        window: ArrayView2<'_, f32>,
        active: &Active,
        first: usize,
        out: &mut [f32],
    ) -> Result<(), Error> {
        let lanes = out.len();
        let bytes = (lanes * size_of::<f32>()) as u64;
        let Gpu { device, queue, .. } = &self.gpu;

        let params = Params {
            lanes: lanes as u32,
            window: window.nrows() as u32,
            layers: self.network.layers().len() as u32,
            negative_slope: self.network.metadata().negative_slope,
        };
        queue.write_buffer(&buffers.params, 0, bytemuck::bytes_of(&params));
        for (t, term) in window.rows().into_iter().enumerate() {
            let term = term.to_slice().expect("a term of all lanes is contiguous");
            // `out` holds the row on its way.
            active.gather(term, first, out);
            queue.write_buffer(&buffers.terms, t as u64 * bytes, bytemuck::cast_slice(out));
        }
        // A lane that the shader failed to write must not look like a result.
        let poison = vec![f32::NAN; lanes];
        queue.write_buffer(&buffers.estimates, 0, bytemuck::cast_slice(&poison));

        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &buffers.bind_group, &[]);
            pass.dispatch_workgroups((lanes as u32).div_ceil(self.lanes_per_workgroup), 1, 1);
        }
        encoder.copy_buffer_to_buffer(&buffers.estimates, 0, &buffers.staging, 0, bytes);
        queue.submit([encoder.finish()]);

        // A mapping that fails shows up below, when the range is asked for.
        buffers.staging.map_async(wgpu::MapMode::Read, 0..bytes, |_| {});
        self.gpu.wait()?;
        let view = buffers
            .staging
            .get_mapped_range(0..bytes)
            .map_err(|error| Error::Gpu(format!("{}: {error}", self.gpu.name)))?;
        bytemuck::cast_slice_mut(out).copy_from_slice(&view[..]);
        drop(view);
        buffers.staging.unmap();
        Ok(())
    }
}

impl Transform for MlpGpu {
    fn window(&self) -> usize {
        self.network.metadata().window
    }

    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Some(window) = batch.window(self.window()) else {
            out.fall_back(batch, Status::TooShort);
            return Ok(());
        };
        out.transform_active(window, |active, out| {
            let chunk = out.len().min(self.max_chunk as usize);
            if chunk == 0 {
                return Ok(());
            }
            let buffers = Buffers::new(self, chunk);
            for (i, out) in out.chunks_mut(chunk).enumerate() {
                self.run_chunk(&buffers, window, active, i * chunk, out)?;
            }
            Ok(())
        })
    }
}

/// The buffers of one batch, reused by its chunks.
struct Buffers {
    params: wgpu::Buffer,
    terms: wgpu::Buffer,
    estimates: wgpu::Buffer,
    staging: wgpu::Buffer,
    bind_group: wgpu::BindGroup,
}

impl Buffers {
    fn new(mlp: &MlpGpu, lanes: usize) -> Self {
        use wgpu::BufferUsages as Usage;
        let device = &mlp.gpu.device;
        let buffer = |label, size: usize, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: size as u64,
                usage,
                mapped_at_creation: false,
            })
        };
        let bytes = lanes * size_of::<f32>();
        let params = buffer("params", size_of::<Params>(), Usage::UNIFORM | Usage::COPY_DST);
        let terms = buffer("terms", mlp.window() * bytes, Usage::STORAGE | Usage::COPY_DST);
        let estimates =
            buffer("estimates", bytes, Usage::STORAGE | Usage::COPY_DST | Usage::COPY_SRC);
        let staging = buffer("staging", bytes, Usage::MAP_READ | Usage::COPY_DST);
        let bound = [&params, &mlp.layers, &mlp.weights, &terms, &estimates];
        let entries = [0, 1, 2, 3, 4].map(|binding: u32| wgpu::BindGroupEntry {
            binding,
            resource: bound[binding as usize].as_entire_binding(),
        });
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("mlp"),
            layout: &mlp.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Self { params, terms, estimates, staging, bind_group }
    }
}

/// The weights as the shader reads them: per layer `[in][out / 4]` and then the
/// biases `[out / 4]`, in vectors of four outputs padded with zeros.
fn pack(network: &Network) -> (Vec<LayerTable>, Vec<[f32; 4]>) {
    let mut packed = Vec::new();
    let table = network
        .layers()
        .iter()
        .map(|layer| {
            let blocks = layer.outputs().div_ceil(4);
            let weights = packed.len() as u32;
            let columns = layer.weight.columns();
            for values in columns.into_iter().chain([layer.bias.view()]) {
                packed.extend((0..blocks).map(|block| {
                    std::array::from_fn(|j| values.get(4 * block + j).copied().unwrap_or(0.0))
                }));
            }
            let biases = packed.len() as u32 - blocks as u32;
            LayerTable { inputs: layer.inputs() as u32, blocks: blocks as u32, weights, biases }
        })
        .collect();
    (table, packed)
}

#[cfg(test)]
mod tests {
    use naga::{
        TypeInner,
        valid::{Capabilities, ValidationFlags, Validator},
    };

    use super::*;

    fn module() -> naga::Module {
        naga::front::wgsl::parse_str(SHADER).expect("the shader parses")
    }

    fn is_valid(module: &naga::Module) -> bool {
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        validator.validate(module).inspect_err(|error| eprintln!("{error:?}")).is_ok()
    }

    /// Needs no adapter.
    #[test]
    fn the_shader_is_valid() {
        assert!(is_valid(&module()));
        // A store to the input, which is read-only, must be noticed.
        let broken = SHADER.replace("estimates[first_lane + i] =", "terms[first_lane + i] =");
        assert_ne!(broken, SHADER);
        assert!(!is_valid(&naga::front::wgsl::parse_str(&broken).expect("it still parses")));
    }

    /// Offsets and sizes as the shader compiler lays them out.
    #[test]
    fn structs_have_the_shaders_layout() {
        let module = module();
        let layout = |name: &str| {
            let (_, ty) = module
                .types
                .iter()
                .find(|(_, ty)| ty.name.as_deref() == Some(name))
                .expect("the shader has this struct");
            match &ty.inner {
                TypeInner::Struct { members, span } => {
                    let members =
                        members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset));
                    (members.collect::<Vec<_>>(), *span as usize)
                }
                _ => panic!("{name} is no struct"),
            }
        };
        let expect = |name: &str, members: &[(&str, usize)], size: usize| {
            let members: Vec<_> = members.iter().map(|&(n, o)| (n.to_owned(), o as u32)).collect();
            assert_eq!(layout(name), (members, size), "{name}");
        };
        use std::mem::offset_of;
        expect(
            "Params",
            &[
                ("lanes", offset_of!(Params, lanes)),
                ("window", offset_of!(Params, window)),
                ("layers", offset_of!(Params, layers)),
                ("negative_slope", offset_of!(Params, negative_slope)),
            ],
            size_of::<Params>(),
        );
        expect(
            "Layer",
            &[
                ("inputs", offset_of!(LayerTable, inputs)),
                ("blocks", offset_of!(LayerTable, blocks)),
                ("weights", offset_of!(LayerTable, weights)),
                ("biases", offset_of!(LayerTable, biases)),
            ],
            size_of::<LayerTable>(),
        );
        let constants: Vec<_> = module
            .constants
            .iter()
            .filter_map(|(_, constant)| {
                let naga::Expression::Literal(naga::Literal::U32(value)) =
                    module.global_expressions[constant.init]
                else {
                    return None;
                };
                Some((constant.name.clone()?, value))
            })
            .collect();
        for (name, value) in [("THREADS", THREADS), ("LANES_PER_GROUP", LANES_PER_GROUP)] {
            assert!(constants.contains(&(name.to_owned(), value)), "{name}: {constants:?}");
        }
    }
}
