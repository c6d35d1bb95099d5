//! The filter as a compute shader, some rows per submission.

use std::{
    ops::Range,
    sync::{Mutex, PoisonError},
};

use bytemuck::{Pod, Zeroable};

use super::{Gpu, buffers::most_bytes};
use crate::{
    Error, Estimates, Fitted, Grid, Requirements, SequenceBatch, Strips, Transform, WelchFilter,
    filter::{Guide, Means, Planes, RADIUS, filter_strip},
};

/// Of planes, per submission, where the adapter sets no lower limit.
const MAX_BYTES: u64 = 64 << 20;

/// Columns and rows of a workgroup, where the adapter sets no lower limit.
const SIDE: u32 = 8;

/// `Params` of `filter.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    width: u32,
    stride: u32,
    planes: u32,
    rows: u32,
    first: u32,
    count: u32,
    channels: u32,
}

/// How many channels are tested together, and how many guides there are.
type Shape = [usize; 2];

/// [`WelchFilter`] in a WGSL compute shader: the same planes, and the same results but for
/// rounding. Rows stream through the device, so that no buffer limit bounds the size of a picture.
#[derive(Debug)]
pub struct FilterGpu {
    gpu: Gpu,
    module: wgpu::ShaderModule,
    side: u32,
    /// Those that were needed so far.
    pipelines: Mutex<Vec<(Shape, wgpu::ComputePipeline)>>,
}

impl FilterGpu {
    /// Compiles the shader, and compares a small picture with the CPU.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device refuses the shader, or if its results are wrong.
    pub fn new(gpu: Gpu) -> Result<Self, Error> {
        Self::compile(gpu, include_str!("filter.wgsl"))
    }

    /// A filter by this source, right or wrong.
    fn compile(gpu: Gpu, source: &str) -> Result<Self, Error> {
        let module = gpu.call(|| {
            Ok(gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("filter"),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            }))
        })?;
        let limits = gpu.device.limits();
        let fits = |side: &u32| {
            let [x, y] = [limits.max_compute_workgroup_size_x, limits.max_compute_workgroup_size_y];
            *side <= x.min(y) && side * side <= limits.max_compute_invocations_per_workgroup
        };
        let side = [SIDE, 4, 2].into_iter().find(fits).unwrap_or(1);
        let filter = Self { gpu, module, side, pipelines: Mutex::default() };
        filter.compare_with_cpu()?;
        Ok(filter)
    }

    /// Fails if the shader does not compute what the CPU does: drivers have compiled right
    /// shaders to wrong programs.
    fn compare_with_cpu(&self) -> Result<(), Error> {
        let grid = Grid::new(23, 9, 3, 0)?;
        // Multiples of the golden ratio are spread evenly, and no two are equal.
        let noise = |i: usize| ((1 + i) as f32 * 0.618_034).fract();
        let mean: Vec<f32> = (0..grid.lanes()).map(|lane| 1.0 + 0.2 * noise(lane)).collect();
        let root: Vec<f32> = mean.iter().map(|mean| (mean - 0.05).sqrt()).collect();
        let values: Vec<f32> = (0..grid.pixels()).map(noise).collect();
        let variances = vec![0.01; values.len()];
        let guide = Guide { values: &values, variances: &variances, scale: 1.0 };
        let guides: [_; 6] = std::array::from_fn(|_| guide);
        let planes =
            Planes::new(&grid, &Means { samples: 16.0, mean: &mean, root: &root }, &guides);
        let [mut on_gpu, mut on_cpu] = [vec![0.0; mean.len()], vec![0.0; mean.len()]];
        self.run(&planes, &mut on_gpu)?;
        WelchFilter::default().run(&planes, &mut on_cpu);
        // Rounding is some 10⁻⁶, and a pixel too many, if a test is that close, 10⁻⁴.
        let right = |(gpu, cpu): (&f32, &f32)| (gpu - cpu).abs() <= 1e-3;
        match on_gpu.iter().zip(&on_cpu).find(|pair| !right(*pair)) {
            None => Ok(()),
            Some((wrong, cpu)) => {
                let what = format!("the filter's results are wrong: {wrong:e}, not {cpu:e}");
                Err(self.gpu.error(what))
            }
        }
    }

    /// Writes the filtered means of the inner rows of `planes`, `[channel][pixel]`; NaN where a
    /// pixel does not count.
    ///
    /// # Errors
    /// [`Error::Gpu`] if the device reports one, or if its limits are too low.
    pub(crate) fn run(&self, planes: &Planes, out: &mut [f32]) -> Result<(), Error> {
        let (width, inner) = (planes.grid.width(), planes.grid.inner_rows());
        let most = self.most_rows(planes)?;
        for start in inner.clone().step_by(most) {
            let rows = start..inner.end.min(start + most);
            let means = self.gpu.call(|| self.submit(planes, rows.clone()))?;
            let part = (start - inner.start) * width..(rows.end - inner.start) * width;
            let planes = out.chunks_exact_mut(inner.len() * width);
            for (plane, means) in planes.zip(means.chunks_exact(part.len())) {
                plane[part.clone()].copy_from_slice(means);
            }
        }
        Ok(())
    }

    /// How many rows may be filtered at the same time.
    fn most_rows(&self, planes: &Planes) -> Result<usize, Error> {
        let row_bytes = (planes.of_row() * size_of::<f32>()) as u64;
        let rows = (most_bytes(&self.gpu).min(MAX_BYTES) / row_bytes)
            .saturating_sub(2 * u64::from(RADIUS));
        let groups = self.gpu.device.limits().max_compute_workgroups_per_dimension;
        let rows = rows.min(u64::from(groups) * u64::from(self.side)) as usize;
        let width = planes.grid.width();
        if rows == 0 || width.div_ceil(self.side as usize) > groups as usize {
            let message = format!("its limits are too low to filter rows of {width} pixels");
            return Err(self.gpu.error(message));
        }
        Ok(rows)
    }

    /// Filters these rows: `[channel][row][column]`.
    fn submit(&self, planes: &Planes, rows: Range<usize>) -> Result<Vec<f32>, Error> {
        use wgpu::BufferUsages as Usage;
        let (grid, reach) = (&planes.grid, RADIUS as usize);
        let around = rows.start.saturating_sub(reach)..grid.rows().min(rows.end + reach);
        let together = if grid.channels() == 3 { 3 } else { 1 };
        let params = Params {
            width: grid.width() as u32,
            stride: planes.stride as u32,
            planes: planes.count() as u32,
            rows: around.len() as u32,
            first: (rows.start - around.start) as u32,
            count: rows.len() as u32,
            channels: grid.channels() as u32,
        };
        let of_row = planes.of_row();
        let values = &planes.values[around.start * of_row..around.end * of_row];
        // A pixel that the shader does not write must not look like a result.
        let mut means = vec![f32::NAN; grid.channels() * rows.len() * grid.width()];
        let buffer = |label, contents: &[u8], usage| {
            let size = contents.len() as u64;
            let usage = usage | Usage::COPY_DST;
            let descriptor = wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            };
            let buffer = self.gpu.device.create_buffer(&descriptor);
            if !usage.contains(Usage::MAP_READ) {
                self.gpu.queue.write_buffer(&buffer, 0, contents);
            }
            buffer
        };
        let bytes = bytemuck::cast_slice(&means);
        let params = buffer("params", bytemuck::bytes_of(&params), Usage::UNIFORM);
        let values = buffer("planes", bytemuck::cast_slice(values), Usage::STORAGE);
        let filtered = buffer("means", bytes, Usage::STORAGE | Usage::COPY_SRC);
        let staging = buffer("staging", bytes, Usage::MAP_READ);
        let size = bytes.len() as u64;

        let pipeline = self.pipeline([together, planes.guides]);
        let bound = [&params, &values, &filtered];
        let entries: Vec<_> = (0_u32..)
            .zip(bound)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let bind_group = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("filter"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &bind_group, &[]);
            let groups = [grid.width(), rows.len()].map(|n| (n as u32).div_ceil(self.side));
            pass.dispatch_workgroups(groups[0], groups[1], (grid.channels() / together) as u32);
        }
        encoder.copy_buffer_to_buffer(&filtered, 0, &staging, 0, size);
        let submission = self.gpu.queue.submit([encoder.finish()]);
        // A mapping that fails shows up when the range is asked for.
        staging.map_async(wgpu::MapMode::Read, 0..size, |_| {});
        self.gpu.wait(Some(submission))?;
        let view = staging.get_mapped_range(0..size).map_err(|error| self.gpu.error(error))?;
        bytemuck::cast_slice_mut(&mut means).copy_from_slice(&view[..]);
        Ok(means)
    }

    fn pipeline(&self, shape: Shape) -> wgpu::ComputePipeline {
        let mut pipelines = self.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, pipeline)) = pipelines.iter().find(|(of, _)| *of == shape) {
            return pipeline.clone();
        }
        let [channels, guides] = shape.map(|count| count as f64);
        let constants =
            [("SIDE", f64::from(self.side)), ("CHANNELS", channels), ("GUIDES", guides)];
        let pipeline = self.gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("filter"),
            layout: None,
            module: &self.module,
            entry_point: Some("transform"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &constants,
                ..Default::default()
            },
            cache: None,
        });
        pipelines.push((shape, pipeline.clone()));
        pipeline
    }
}

impl Transform for FilterGpu {
    fn requires(&self) -> Requirements {
        WelchFilter::default().requires()
    }

    fn fit<'a>(&'a self, _: &mut dyn Strips) -> Result<Box<dyn Fitted + 'a>, Error> {
        Ok(Box::new(self))
    }
}

impl Fitted for FilterGpu {
    fn apply(&self, strip: &SequenceBatch, out: &mut Estimates) -> Result<(), Error> {
        filter_strip(strip, out, |planes, values| self.run(planes, values))
    }
}

#[cfg(test)]
mod tests;
