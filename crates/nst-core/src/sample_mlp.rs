//! Evaluates networks that see samples, as experts of the guard.
//!
//! The inputs are computed on the CPU, in f64, and rounded to f32: neighbouring L_p may be
//! nearly equal, and WGSL has no f64. The layers are those of [`MlpCpu`], or of
//! [`MlpGpu`](crate::gpu::MlpGpu).

use ndarray::Array2;
use rayon::prelude::*;

#[cfg(feature = "gpu")]
use crate::gpu::Gpu;
use crate::{
    Error, MlpCpu, Power, SampleNetwork,
    evaluator::Evaluator,
    guard::{Expert, Features, Seen},
};

/// Lanes whose inputs are in memory at a time, at most 1 MiB for each input.
const CHUNK: usize = 1 << 18;

/// A [`SampleNetwork`] as an [`Expert`] of the [guard](crate::guard::Guard).
///
/// A lane's bits do not depend on the lanes beside it. Lanes where a number is not finite get the
/// plain estimate.
#[derive(Debug)]
pub struct SampleMlp {
    name: String,
    network: SampleNetwork,
    layers: Evaluator,
    refit: Option<Refit>,
}

/// What the guard needs to fit the last layer again.
#[derive(Debug)]
struct Refit {
    mlp: MlpCpu,
    /// Weights and bias of the last layer.
    coefficients: Vec<f32>,
}

impl SampleMlp {
    /// An expert of this name, with layers on the CPU.
    #[must_use]
    pub fn new(name: impl Into<String>, network: SampleNetwork) -> Self {
        let layers = Evaluator::on_cpu(network.layers());
        Self { name: name.into(), network, layers, refit: None }
    }

    /// An expert of this name, with layers on a GPU. If the GPU fails later, so does
    /// [`Expert::estimate`].
    ///
    /// # Errors
    /// As for [`MlpGpu::new`](crate::gpu::MlpGpu::new).
    #[cfg(feature = "gpu")]
    pub fn on_gpu(
        name: impl Into<String>,
        network: SampleNetwork,
        gpu: Gpu,
    ) -> Result<Self, Error> {
        let layers = Evaluator::on_gpu(network.layers(), gpu)?;
        Ok(Self { name: name.into(), network, layers, refit: None })
    }

    /// Lets the guard fit the last layer again, to the very batch, as one more expert. Other
    /// layers of that are on the CPU.
    #[must_use]
    pub fn with_refit(self) -> Self {
        let mlp = MlpCpu::new(self.network.layers().clone());
        let last = self.network.layers().layers().last().expect("a network has layers");
        let coefficients = last.weight.iter().chain(&last.bias).copied().collect();
        Self { refit: Some(Refit { mlp, coefficients }), ..self }
    }

    /// The network.
    #[must_use]
    pub fn network(&self) -> &SampleNetwork {
        &self.network
    }

    fn means<'a>(&self, seen: &Seen<'a>) -> Result<Vec<Means<'a>>, Error> {
        self.network.form().powers.iter().map(|&power| Means::new(seen, power)).collect()
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

    fn adapts(&self) -> Option<&dyn Features> {
        self.refit.as_ref().map(|_| self as &dyn Features)
    }

    fn estimate(&self, seen: &Seen<'_>, out: &mut [f32]) -> Result<(), Error> {
        let means = self.means(seen)?;
        for (chunk, out) in out.chunks_mut(CHUNK).enumerate() {
            let first = chunk * CHUNK;
            let inputs = self.inputs(seen, &means, first, out.len());
            self.layers.evaluate(inputs.view(), out)?;
            for (lane, out) in (first..).zip(out) {
                let plain = seen.mean[lane];
                let change = self.network.scale(plain.into(), seen.unit) * f64::from(*out);
                let estimate = (f64::from(plain) + change) as f32;
                *out = if estimate.is_finite() { estimate } else { plain };
            }
        }
        Ok(())
    }
}

impl Features for SampleMlp {
    fn coefficients(&self) -> &[f32] {
        self.refit.as_ref().map_or(&[], |refit| &refit.coefficients)
    }

    /// The last hidden layer and 1, times what an output of 1 adds to S.
    fn features(&self, seen: &Seen<'_>, out: &mut [f32]) -> Result<(), Error> {
        let (Some(refit), means) = (&self.refit, self.means(seen)?) else { return Ok(()) };
        let width = refit.coefficients.len();
        for (chunk, out) in out.chunks_mut(CHUNK * width).enumerate() {
            let first = chunk * CHUNK;
            let lanes = out.len() / width;
            let hidden = refit.mlp.hidden(self.inputs(seen, &means, first, lanes).view());
            let rows = out.chunks_exact_mut(width).zip(hidden.chunks_exact(width - 1));
            for (lane, (row, hidden)) in (first..).zip(rows) {
                let scale = self.network.scale(seen.mean[lane].into(), seen.unit) as f32;
                let features = hidden.iter().chain(&[1.0]);
                row.iter_mut().zip(features).for_each(|(x, feature)| *x = scale * feature);
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
