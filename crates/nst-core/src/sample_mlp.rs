//! Evaluates networks that see samples, as experts of the guard.
//!
//! The inputs are computed on the CPU, in f64, and rounded to f32: neighbouring L_p may be
//! nearly equal, and WGSL has no f64. The layers are those of [`MlpCpu`], or of
//! [`MlpGpu`](crate::gpu::MlpGpu).

use ndarray::Array2;
use rayon::prelude::*;

#[cfg(feature = "gpu")]
use crate::gpu::{Gpu, MlpGpu};
use crate::{
    Error, MlpCpu, Power, SampleNetwork,
    guard::{Expert, Seen},
};

/// Lanes whose inputs are in memory at a time, at most 1 MiB for each input.
const CHUNK: usize = 1 << 18;

/// A [`SampleNetwork`] as an [`Expert`] of the [guard](crate::guard::Guard).
///
/// A lane's bits do not depend on the lanes beside it. Lanes of which all samples were 0, or
/// where a number is not finite, get the plain estimate.
#[derive(Debug)]
pub struct SampleMlp {
    name: String,
    network: SampleNetwork,
    layers: Layers,
}

#[derive(Debug)]
enum Layers {
    Cpu(MlpCpu),
    #[cfg(feature = "gpu")]
    Gpu(MlpGpu),
}

impl SampleMlp {
    /// An expert of this name, with layers on the CPU.
    #[must_use]
    pub fn new(name: impl Into<String>, network: SampleNetwork) -> Self {
        let layers = Layers::Cpu(MlpCpu::new(network.layers().clone()));
        Self { name: name.into(), network, layers }
    }

    /// An expert of this name, with layers on a GPU. If the GPU fails later, so does
    /// [`Expert::estimate`].
    ///
    /// # Errors
    /// As for [`MlpGpu::new`].
    #[cfg(feature = "gpu")]
    pub fn on_gpu(
        name: impl Into<String>,
        network: SampleNetwork,
        gpu: Gpu,
    ) -> Result<Self, Error> {
        let layers = Layers::Gpu(MlpGpu::new(gpu, network.layers().clone())?);
        Ok(Self { name: name.into(), network, layers })
    }

    /// The network.
    #[must_use]
    pub fn network(&self) -> &SampleNetwork {
        &self.network
    }

    /// The inputs of some lanes, `[input][lane]`.
    fn inputs(
        &self,
        seen: &Seen<'_>,
        means: &[Means<'_>],
        first: usize,
        lanes: usize,
    ) -> Array2<f32> {
        let width = self.network.form().inputs();
        let mut inputs = Array2::zeros((lanes, width));
        let rows = inputs.as_slice_mut().expect("it is new").par_chunks_exact_mut(width);
        rows.enumerate().for_each(|(lane, row)| {
            let means = means.iter().map(|means| means.of_lane(first + lane));
            self.network.inputs(means, seen.samples, seen.unit, row);
        });
        inputs.reversed_axes().as_standard_layout().into_owned()
    }
}

impl Expert for SampleMlp {
    fn name(&self) -> &str {
        &self.name
    }

    fn powers(&self) -> &[Power] {
        &self.network.form().powers
    }

    fn estimate(&self, seen: &Seen<'_>, out: &mut [f32]) -> Result<(), Error> {
        let powers = self.network.form().powers.iter();
        let means = powers.map(|&power| Means::new(seen, power)).collect::<Result<Vec<_>, _>>()?;
        for (chunk, out) in out.chunks_mut(CHUNK).enumerate() {
            let first = chunk * CHUNK;
            let inputs = self.inputs(seen, &means, first, out.len());
            match &self.layers {
                Layers::Cpu(mlp) => mlp.evaluate_all(inputs.view(), out),
                #[cfg(feature = "gpu")]
                Layers::Gpu(mlp) => mlp.evaluate_all(inputs.view(), out)?,
            }
            for (lane, out) in (first..).zip(out) {
                let plain = seen.mean[lane];
                let black = [plain, seen.root[lane], seen.square[lane]] == [0.0; 3];
                let estimate = self.network.estimate(plain.into(), seen.unit, (*out).into()) as f32;
                *out = if black || !estimate.is_finite() { plain } else { estimate };
            }
        }
        Ok(())
    }
}

/// The means of a power of the samples, `[lane]`.
struct Means<'a> {
    power: Power,
    /// m_p of a power that every batch has; M_p of another.
    means: &'a [f32],
}

impl<'a> Means<'a> {
    fn new(seen: &Seen<'a>, power: Power) -> Result<Self, Error> {
        let means = match power {
            Power::ROOT => Some(seen.root),
            Power::ONE => Some(seen.mean),
            Power::SQUARE => Some(seen.square),
            _ => seen.further.iter().find(|(known, _)| *known == power).map(|(_, means)| &**means),
        };
        let means = means.ok_or_else(|| {
            let message = format!("the batch has no means of its samples to the power {power}");
            Error::Batch(message)
        })?;
        Ok(Self { power, means })
    }

    /// M_p of a lane.
    fn of_lane(&self, lane: usize) -> f64 {
        let mean = f64::from(self.means[lane]);
        if self.power.is_usual() { self.power.mean_of(mean) } else { mean }
    }
}
