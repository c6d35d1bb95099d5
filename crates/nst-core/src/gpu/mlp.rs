//! The network as a compute shader: buffers, chunks and submissions.

use std::sync::{Arc, Mutex, PoisonError};

use ndarray::{Array2, ArrayView2};

use super::{
    Gpu,
    fault::{self, Fault},
    shader::{Kernel, Packed, Params, Precision, Variant},
};
use crate::{
    Error, Estimates, MlpCpu, Network, SequenceBatch, Status, Transform,
    compact::{Selection, transform_active},
};

/// Lanes per submission where the adapter sets no lower limit: 8 MiB of terms at
/// window 8. Two are under way at a time.
const MAX_CHUNK: u64 = 1 << 18;

/// Lanes on which a kernel that nobody has tried on an adapter is compared with the CPU:
/// no multiple of any tile.
const COMPARED: usize = 333;

/// How far it may be off, relative to the largest estimate. Rounding to f16 is some 10⁻³,
/// and more where a network's terms cancel; a wrong kernel is off by about 1.
const LARGEST_DIFFERENCE: f32 = 2e-2;

/// How [`MlpGpu`] is to evaluate a network.
#[derive(Clone, Copy, Debug, Default)]
pub struct GpuOptions {
    /// The shader.
    pub kernel: Kernel,
    /// Of the weights.
    pub precision: Precision,
}

/// Evaluates a [`Network`] in a WGSL compute shader; lanes stream through the
/// device in chunks, so that no buffer limit bounds the size of a batch. While one
/// chunk is computed, the next is uploaded.
#[derive(Debug)]
pub struct MlpGpu {
    gpu: Gpu,
    network: Arc<Network>,
    pipeline: wgpu::ComputePipeline,
    layers: wgpu::Buffer,
    weights: wgpu::Buffer,
    /// Weights in f16, of the cooperative kernel.
    halves: Option<wgpu::Buffer>,
    lanes_per_workgroup: u32,
    max_chunk: u32,
    /// Kept from batch to batch.
    buffers: Mutex<Vec<Buffers>>,
}

impl MlpGpu {
    /// Compiles the shader and uploads the weights, in f32.
    ///
    /// # Errors
    /// [`Error::Gpu`] if a layer is wider than 256, if the adapter's limits are too low,
    /// or if the device refuses the shader.
    pub fn new(gpu: Gpu, network: impl Into<Arc<Network>>) -> Result<Self, Error> {
        Self::with_options(gpu, network, GpuOptions::default())
    }

    /// The same, with a choice of kernel and precision.
    ///
    /// # Errors
    /// As for [`Self::new`]; also if f16 or cooperative matrices are asked for and the
    /// adapter lacks them, if a weight exceeds f16, or if cooperative matrices are wrong.
    pub fn with_options(
        gpu: Gpu,
        network: impl Into<Arc<Network>>,
        options: GpuOptions,
    ) -> Result<Self, Error> {
        let network = network.into();
        let variant = Variant::new(&gpu, &network, options.kernel)?;
        let half = options.precision == Precision::F16;
        if half && !gpu.has_f16() {
            return Err(Error::Gpu(format!("{}: it has no f16", gpu.name)));
        }
        if !half && options.kernel == Kernel::Cooperative {
            return Err(Error::Gpu("cooperative matrices are in f16 only".into()));
        }
        let mut source = variant.source(options.precision);
        if fault::wanted() == Some(Fault::Shader) {
            source = source.replacen("leaky_relu", "leaky_rule", 1);
        }
        let mlp = Self::compile(gpu, network, &variant, options.precision, source)?;
        if options.kernel == Kernel::Cooperative {
            mlp.compare_with_cpu()?;
        }
        Ok(mlp)
    }

    /// Fails if the GPU does not compute what the CPU does, on some windows in [0, 1).
    fn compare_with_cpu(&self) -> Result<(), Error> {
        let window = Array2::from_shape_fn((self.window(), COMPARED), |(term, lane)| {
            // Multiples of the golden ratio are spread evenly, and no two are equal.
            ((1 + term * COMPARED + lane) as f32 * 0.618_034).fract()
        });
        let batch = SequenceBatch::new(window, (1..=self.window() as u32).collect())?;
        let (mut on_gpu, mut on_cpu) = (Estimates::default(), Estimates::default());
        self.apply(&batch, &mut on_gpu)?;
        MlpCpu::new(Arc::clone(&self.network)).apply(&batch, &mut on_cpu)?;
        let pairs = || on_gpu.values().iter().zip(on_cpu.values());
        let error = pairs().map(|(gpu, cpu)| (gpu - cpu).abs()).fold(0.0, f32::max);
        let scale = pairs().map(|(_, cpu)| cpu.abs()).fold(0.0, f32::max);
        if on_gpu.status() == on_cpu.status() && error <= LARGEST_DIFFERENCE * scale {
            return Ok(());
        }
        let name = &self.gpu.name;
        Err(Error::Gpu(format!("{name}: its results differ from the CPU's by up to {error:e}")))
    }

    fn compile(
        gpu: Gpu,
        network: Arc<Network>,
        variant: &Variant,
        precision: Precision,
        source: String,
    ) -> Result<Self, Error> {
        let device = &gpu.device;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("mlp"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        // A module that is not valid makes pipelines that are not: the first error counts.
        gpu.check()?;
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("mlp"),
            layout: None,
            module: &module,
            entry_point: Some("transform"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &variant.constants,
                ..Default::default()
            },
            cache: None,
        });
        let Packed { layers, weights, halves } = variant.pack(&network, precision)?;
        // Not `create_buffer_init`, which panics if the device is lost.
        let upload = |label, contents: &[u8]| {
            let buffer = device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: contents.len() as u64,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            gpu.queue.write_buffer(&buffer, 0, contents);
            buffer
        };
        let limits = device.limits();
        let most_bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let too_small = || Error::Gpu(format!("{}: its buffers are too small", gpu.name));
        if weights.len().max(halves.as_ref().map_or(0, Vec::len)) as u64 > most_bytes {
            return Err(too_small());
        }
        let layers = upload("layers", bytemuck::cast_slice(&layers));
        let weights = upload("weights", &weights);
        let halves = halves.map(|halves| upload("halves", &halves));
        gpu.check()?;

        let bytes_per_lane = (network.metadata().window * size_of::<f32>()) as u64;
        let lanes_per_workgroup = variant.lanes_per_workgroup;
        let workgroups = u64::from(limits.max_compute_workgroups_per_dimension);
        let max_chunk = MAX_CHUNK
            .min(most_bytes / bytes_per_lane)
            .min(workgroups * u64::from(lanes_per_workgroup)) as u32;
        if max_chunk == 0 {
            return Err(too_small());
        }
        let buffers = Mutex::default();
        Ok(Self {
            gpu,
            network,
            pipeline,
            layers,
            weights,
            halves,
            lanes_per_workgroup,
            max_chunk,
            buffers,
        })
    }

    /// Uploads lanes of `selection`, as many as `scratch` has room for, from its number
    /// `first` on, and has them evaluated.
    fn submit(
        &self,
        buffers: &mut Buffers,
        window: ArrayView2<'_, f32>,
        selection: Selection<'_>,
        first: usize,
        scratch: &mut [f32],
    ) {
        let count = scratch.len();
        let bytes = size_of_val(scratch) as u64;
        let Gpu { device, queue, .. } = &self.gpu;

        let params = Params {
            lanes: count as u32,
            window: window.nrows() as u32,
            layers: self.network.layers().len() as u32,
            negative_slope: self.network.metadata().negative_slope,
        };
        queue.write_buffer(&buffers.params, 0, bytemuck::bytes_of(&params));
        for (t, term) in window.rows().into_iter().enumerate() {
            let term = term.to_slice().expect("a term of all lanes is contiguous");
            selection.gather(term, first, scratch);
            queue.write_buffer(&buffers.terms, t as u64 * bytes, bytemuck::cast_slice(scratch));
        }
        // A lane that the shader failed to write must not look like a result.
        scratch.fill(f32::NAN);
        queue.write_buffer(&buffers.estimates, 0, bytemuck::cast_slice(scratch));

        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &buffers.bind_group, &[]);
            pass.dispatch_workgroups((count as u32).div_ceil(self.lanes_per_workgroup), 1, 1);
        }
        encoder.copy_buffer_to_buffer(&buffers.estimates, 0, &buffers.staging, 0, bytes);
        buffers.submission = Some(queue.submit([encoder.finish()]));
        // A mapping that fails shows up when the range is asked for.
        buffers.staging.map_async(wgpu::MapMode::Read, 0..bytes, |_| {});
    }

    /// Waits for what was submitted with these buffers, and reads the estimates.
    fn read_back(&self, buffers: &mut Buffers, out: &mut [f32]) -> Result<(), Error> {
        self.gpu.wait(buffers.submission.take())?;
        let view = buffers
            .staging
            .get_mapped_range(0..size_of_val(out) as u64)
            .map_err(|error| Error::Gpu(format!("{}: {error}", self.gpu.name)))?;
        bytemuck::cast_slice_mut(out).copy_from_slice(&view[..]);
        drop(view);
        buffers.staging.unmap();
        Ok(())
    }

    /// Evaluates the lanes, chunk by chunk, with two sets of buffers in turns.
    fn evaluate(
        &self,
        window: ArrayView2<'_, f32>,
        selection: Selection<'_>,
        out: &mut [f32],
    ) -> Result<(), Error> {
        if out.is_empty() {
            return Ok(());
        }
        self.gpu.check()?;
        let chunk = out.len().min(self.max_chunk as usize);
        let sets = out.len().div_ceil(chunk).min(2);
        let kept = std::mem::take(&mut *self.buffers());
        let mut kept = kept.into_iter().filter(|buffers| buffers.lanes >= chunk);
        let mut buffers: Vec<_> =
            (0..sets).map(|_| kept.next().unwrap_or_else(|| Buffers::new(self, chunk))).collect();
        if fault::wanted() == Some(Fault::Memory) {
            self.gpu.failure.report(wgpu::Error::OutOfMemory { source: "a fault".into() });
        }
        self.gpu.check()?;

        let mut under_way: Option<(usize, &mut [f32])> = None;
        for (i, out) in out.chunks_mut(chunk).enumerate() {
            self.submit(&mut buffers[i % sets], window, selection, i * chunk, out);
            if fault::wanted() == Some(Fault::Lost) {
                self.gpu.lose();
            }
            if let Some((before, out)) = under_way.replace((i, out)) {
                self.read_back(&mut buffers[before % sets], out)?;
            }
        }
        if let Some((before, out)) = under_way {
            self.read_back(&mut buffers[before % sets], out)?;
        }
        *self.buffers() = buffers;
        Ok(())
    }

    fn buffers(&self) -> std::sync::MutexGuard<'_, Vec<Buffers>> {
        self.buffers.lock().unwrap_or_else(PoisonError::into_inner)
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
        transform_active(window, out, |selection, out| self.evaluate(window, selection, out))
    }
}

/// The buffers of one chunk.
#[derive(Debug)]
struct Buffers {
    /// Room for so many.
    lanes: usize,
    params: wgpu::Buffer,
    terms: wgpu::Buffer,
    estimates: wgpu::Buffer,
    staging: wgpu::Buffer,
    bind_group: wgpu::BindGroup,
    /// What they are in use for.
    submission: Option<wgpu::SubmissionIndex>,
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
        let bound = bound.into_iter().chain(&mlp.halves);
        let entries: Vec<_> = (0_u32..)
            .zip(bound)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("mlp"),
            layout: &mlp.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Self { lanes, params, terms, estimates, staging, bind_group, submission: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::AdapterKind;

    /// Skipped where there is no adapter, as `NST_GPU` allows; it says so.
    #[test]
    fn a_shader_that_does_not_compile_or_is_wrong_is_an_error() {
        let gpu = match std::env::var("NST_GPU").as_deref() {
            Ok("off") => return eprintln!("skipped: NST_GPU=off"),
            Ok("require") => Gpu::open(AdapterKind::Any).expect("NST_GPU=require"),
            _ => match Gpu::open(AdapterKind::Any) {
                Ok(gpu) => gpu,
                Err(error) => return eprintln!("skipped: {error}"),
            },
        };
        let network = Network::builtin("families").expect("it is in the crate");
        let network = Arc::new(network.expect("it is readable"));
        let compile = |gpu: &Gpu, source: String| {
            let variant = Variant::new(gpu, &network, Kernel::Tiled).expect("it fits");
            MlpGpu::compile(gpu.clone(), Arc::clone(&network), &variant, Precision::F32, source)
        };
        let variant = Variant::new(&gpu, &network, Kernel::Tiled).expect("it fits");
        let right = variant.source(Precision::F32);
        assert!(compile(&gpu, right.clone()).is_ok());
        let wrong = right.replacen("params.negative_slope", "0.5", 1);
        assert_ne!(wrong, right);
        for (source, agrees) in [(right.clone(), true), (wrong, false)] {
            let mlp = compile(&gpu, source).expect("it compiles");
            assert_eq!(mlp.compare_with_cpu().is_ok(), agrees);
        }
        for (good, bad) in [("leaky_relu", "leaky_rule"), ("params.lanes", "params.lane")] {
            let gpu = Gpu::open(AdapterKind::Any).expect("it opened before");
            let error = compile(&gpu, right.replacen(good, bad, 1)).expect_err(bad);
            assert!(matches!(error, Error::Gpu(_)), "{error}");
        }
    }
}
