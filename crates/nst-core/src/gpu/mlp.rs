//! The network as a compute shader: chunks of lanes, and their submissions.

use std::sync::{Arc, Mutex, PoisonError};

use ndarray::ArrayView2;

use super::{
    Gpu,
    buffers::{Buffers, Weights, most_bytes},
    check::compare_with_cpu,
    fault::{self, Fault},
    kernel::Variant,
    options::GpuOptions,
    pack::Params,
};
use crate::{
    Error, Estimates, Fitted, Network, Requirements, SequenceBatch, Status, Strips, Transform,
    compact::{Selection, transform_active},
};

/// Lanes per submission where the adapter sets no lower limit: 8 MiB of terms at
/// window 8. Two are under way at a time.
const MAX_CHUNK: u64 = 1 << 18;

/// Evaluates a [`Network`] in a WGSL compute shader; lanes stream through the
/// device in chunks, so that no buffer limit bounds the size of a batch. While one
/// chunk is computed, the next is uploaded.
#[derive(Debug)]
pub struct MlpGpu {
    gpu: Gpu,
    network: Arc<Network>,
    pipeline: wgpu::ComputePipeline,
    weights: Weights,
    lanes_per_workgroup: u32,
    max_chunk: u32,
    /// Kept from batch to batch.
    buffers: Mutex<Vec<Buffers>>,
}

impl MlpGpu {
    /// Compiles the shader, uploads the weights, in f32, and compares some lanes with the CPU.
    ///
    /// # Errors
    /// [`Error::Gpu`] if a layer is wider than 256, if the adapter's limits are too low,
    /// if the device refuses the shader, or if its results are wrong.
    pub fn new(gpu: Gpu, network: impl Into<Arc<Network>>) -> Result<Self, Error> {
        Self::with_options(gpu, network, GpuOptions::default())
    }

    /// The same, with a choice of kernel and precision.
    ///
    /// # Errors
    /// As for [`Self::new`]; also if f16 or cooperative matrices are asked for and the
    /// adapter lacks them, or if a weight exceeds f16.
    pub fn with_options(
        gpu: Gpu,
        network: impl Into<Arc<Network>>,
        GpuOptions { kernel, precision }: GpuOptions,
    ) -> Result<Self, Error> {
        let network = network.into();
        let variant = Variant::new(&gpu, &network, kernel, precision)?;
        let mut source = variant.source();
        if fault::wanted() == Some(Fault::Shader) {
            source = source.replacen("leaky_relu", "leaky_rule", 1);
        }
        let mlp = Self::compile(gpu, network, &variant, source)?;
        compare_with_cpu(&mlp.gpu, &mlp.network, (kernel, precision), |window, out| {
            mlp.evaluate(window, Selection::From(0), out, None)
        })?;
        Ok(mlp)
    }

    /// How many terms the network reads.
    fn window(&self) -> usize {
        self.network.metadata().window
    }

    /// An evaluation by this source, right or wrong.
    pub(super) fn compile(
        gpu: Gpu,
        network: Arc<Network>,
        variant: &Variant,
        source: String,
    ) -> Result<Self, Error> {
        let lanes_per_workgroup = variant.lanes_per_workgroup;
        let max_chunk = max_chunk(&gpu, network.metadata().window, lanes_per_workgroup)?;
        let packed = variant.pack(&network)?;
        let weights = gpu.call(|| Weights::upload(&gpu, &packed))?;
        let pipeline = pipeline(&gpu, variant, source)?;
        let buffers = Mutex::default();
        Ok(Self { gpu, network, pipeline, weights, lanes_per_workgroup, max_chunk, buffers })
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
            .map_err(|error| self.gpu.error(error))?;
        bytemuck::cast_slice_mut(out).copy_from_slice(&view[..]);
        drop(view);
        buffers.staging.unmap();
        Ok(())
    }

    /// Evaluates `out.len()` lanes of a window `[term][lane]`, chunk by chunk; `fault` is what
    /// is to fail.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device reports one; the next call is then free of it, unless the
    /// device is lost.
    pub(super) fn evaluate(
        &self,
        window: ArrayView2<'_, f32>,
        selection: Selection<'_>,
        out: &mut [f32],
        fault: Option<Fault>,
    ) -> Result<(), Error> {
        if out.is_empty() {
            return Ok(());
        }
        let chunk = out.len().min(self.max_chunk as usize);
        let sets = out.len().div_ceil(chunk).min(2);
        let mut buffers = self.gpu.call(|| match fault {
            Some(Fault::Memory) => Err(self.gpu.error("it is out of memory")),
            Some(Fault::Panic) => panic!("the driver panics"),
            _ => Ok(self.take_buffers(sets, chunk)),
        })?;
        self.gpu.call(|| self.stream(&mut buffers, chunk, window, selection, out, fault))?;
        *self.buffers() = buffers;
        Ok(())
    }

    /// Evaluates all lanes of inputs `[input][lane]`, also where they are constant.
    ///
    /// # Errors
    /// Those of [`Self::evaluate`].
    pub(crate) fn evaluate_all(
        &self,
        inputs: ArrayView2<'_, f32>,
        out: &mut [f32],
    ) -> Result<(), Error> {
        self.evaluate(inputs, Selection::From(0), out, fault::wanted())
    }

    /// As many sets of buffers, each with room for a chunk of lanes.
    fn take_buffers(&self, sets: usize, chunk: usize) -> Vec<Buffers> {
        let kept = std::mem::take(&mut *self.buffers());
        let mut kept = kept.into_iter().filter(|buffers| buffers.lanes >= chunk);
        let new = || Buffers::new(&self.gpu, &self.pipeline, &self.weights, self.window(), chunk);
        (0..sets).map(|_| kept.next().unwrap_or_else(new)).collect()
    }

    /// Evaluates chunk after chunk, with the sets of buffers in turns: while one is computed,
    /// the next is uploaded.
    fn stream(
        &self,
        buffers: &mut [Buffers],
        chunk: usize,
        window: ArrayView2<'_, f32>,
        selection: Selection<'_>,
        out: &mut [f32],
        fault: Option<Fault>,
    ) -> Result<(), Error> {
        let sets = buffers.len();
        let mut under_way: Option<(usize, &mut [f32])> = None;
        for (i, out) in out.chunks_mut(chunk).enumerate() {
            self.submit(&mut buffers[i % sets], window, selection, i * chunk, out);
            if fault == Some(Fault::Lost) {
                self.gpu.lose();
            }
            if let Some((before, out)) = under_way.replace((i, out)) {
                self.read_back(&mut buffers[before % sets], out)?;
            }
        }
        if let Some((before, out)) = under_way {
            self.read_back(&mut buffers[before % sets], out)?;
        }
        Ok(())
    }

    fn buffers(&self) -> std::sync::MutexGuard<'_, Vec<Buffers>> {
        self.buffers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Lanes per submission, as the adapter's limits allow.
fn max_chunk(gpu: &Gpu, window: usize, lanes_per_workgroup: u32) -> Result<u32, Error> {
    let bytes_per_lane = (window * size_of::<f32>()) as u64;
    let workgroups = u64::from(gpu.device.limits().max_compute_workgroups_per_dimension);
    let lanes = MAX_CHUNK
        .min(most_bytes(gpu) / bytes_per_lane)
        .min(workgroups * u64::from(lanes_per_workgroup));
    if lanes == 0 {
        return Err(gpu.error(format!("its buffers are too small for a window of {window} terms")));
    }
    Ok(lanes as u32)
}

fn pipeline(gpu: &Gpu, variant: &Variant, source: String) -> Result<wgpu::ComputePipeline, Error> {
    let module = gpu.call(|| {
        Ok(gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("mlp"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        }))
    })?;
    gpu.call(|| {
        Ok(gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("mlp"),
            layout: None,
            module: &module,
            entry_point: Some("transform"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &variant.constants,
                ..Default::default()
            },
            cache: None,
        }))
    })
}

impl Transform for MlpGpu {
    fn requires(&self) -> Requirements {
        Requirements::of_lane(self.window())
    }

    fn fit<'a>(&'a self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        Ok(Box::new(self))
    }
}

impl Fitted for MlpGpu {
    fn apply(&self, batch: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        let Some(window) = batch.window(self.window()) else {
            out.fall_back(batch, Status::TooShort);
            return Ok(());
        };
        transform_active(window, out, |selection, out| {
            self.evaluate(window, selection, out, fault::wanted())
        })
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;
    use crate::gpu::{AdapterKind, LowerLimits, check::tests::adapter};

    fn network() -> Arc<Network> {
        let network = Network::builtin("families").expect("it is in the crate");
        Arc::new(network.expect("it is readable"))
    }

    fn batch(lanes: usize) -> SequenceBatch {
        let window = Array2::from_shape_fn((8, lanes), |(t, lane)| (t * lanes + lane) as f32);
        SequenceBatch::new(window, (1..=8).collect()).expect("a batch")
    }

    /// Fails with words that say why; and what the same device does next is as before.
    fn fails_alone(gpu: &Gpu, words: &str, call: impl FnOnce() -> Result<(), Error>) {
        let evaluate = || {
            let mut out = Estimates::default();
            MlpGpu::new(gpu.clone(), network())?.apply(&batch(100), &mut out).map(|()| out)
        };
        let before = evaluate().expect("it works before");
        let error = call().expect_err(words);
        assert!(error.to_string().contains(words), "'{words}' is not in: {error}");
        assert_eq!(evaluate().expect("it works after"), before, "after: {error}");
    }

    #[test]
    fn a_refused_shader_fails_alone() {
        let Some(gpu) = adapter(|| Gpu::open(AdapterKind::Any)) else { return };
        let options = GpuOptions::default();
        let variant = Variant::new(&gpu, &network(), options.kernel, options.precision);
        let variant = variant.expect("it fits");
        // Names that are not known: to the parser, and to the pipeline.
        for (good, bad, words) in [
            ("leaky_relu", "leaky_rule", "no definition in scope"),
            ("params.lanes", "params.lane", "invalid field"),
            ("fn transform", "fn transfer", "entry point"),
        ] {
            let source = variant.source().replacen(good, bad, 1);
            fails_alone(&gpu, words, || {
                MlpGpu::compile(gpu.clone(), network(), &variant, source).map(drop)
            });
        }
    }

    #[test]
    fn a_buffer_that_is_too_large_fails_alone() {
        let Some(gpu) = adapter(|| Gpu::open(AdapterKind::Any)) else { return };
        let mlp = MlpGpu::new(gpu.clone(), network()).expect("it fits");
        let lanes = gpu.device.limits().max_buffer_size as usize / size_of::<f32>() + 1;
        fails_alone(&gpu, "size", || gpu.call(|| Ok(mlp.take_buffers(1, lanes))).map(drop));
    }

    /// A call that asks for more than the device's limits, and the next that does not, both
    /// of the same evaluation.
    #[test]
    fn a_wrong_call_fails_alone() {
        let limits = LowerLimits { binding_bytes: Some(20_000), ..LowerLimits::default() };
        let Some(gpu) = adapter(|| Gpu::open_with(AdapterKind::Any, &limits)) else { return };
        let mut mlp = MlpGpu::new(gpu.clone(), network()).expect("it is large enough");
        let (mut before, mut after) = (Estimates::default(), Estimates::default());
        mlp.apply(&batch(10_000), &mut before).expect("it works before");
        let fitting = std::mem::replace(&mut mlp.max_chunk, 10_000);
        fails_alone(&gpu, "binding", || mlp.apply(&batch(10_000), &mut Estimates::default()));
        mlp.max_chunk = fitting;
        mlp.apply(&batch(10_000), &mut after).expect("it works after");
        assert_eq!(after, before);
    }
}
