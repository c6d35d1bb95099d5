//! A network that corrects the closed form's weights.

mod inputs;

use ndarray::{Array2, ArrayView2};

use self::inputs::DARK;
pub(crate) use self::inputs::INPUTS;
pub(super) use self::inputs::{Input, Inputs};
use super::{
    fits::{Fits, OfCell},
    simplex::MOST,
};
#[cfg(feature = "gpu")]
use crate::gpu::Gpu;
use crate::{Error, GuardNetwork, evaluator::Evaluator};

/// A [`GuardNetwork`] that can be evaluated.
#[derive(Debug)]
pub struct GuardMlp {
    network: GuardNetwork,
    /// `[expert]`
    outputs: Vec<Evaluator>,
}

impl GuardMlp {
    /// With layers on the CPU.
    #[must_use]
    pub fn new(network: GuardNetwork) -> Self {
        let outputs = network.outputs().iter().map(Evaluator::on_cpu).collect();
        Self { network, outputs }
    }

    /// With layers on a GPU. If that fails later, the closed form's weights are used.
    ///
    /// # Errors
    /// As for [`MlpGpu::new`](crate::gpu::MlpGpu::new).
    #[cfg(feature = "gpu")]
    pub fn on_gpu(network: GuardNetwork, gpu: &Gpu) -> Result<Self, Error> {
        let outputs = network.outputs().iter();
        let outputs = outputs.map(|output| Evaluator::on_gpu(output, gpu.clone()));
        let outputs = outputs.collect::<Result<_, _>>()?;
        Ok(Self { network, outputs })
    }

    /// The weights of experts, `[row][expert]`, by rows of inputs, `[input][row]`, and the closed
    /// form's weights, `[row][expert]`.
    ///
    /// # Errors
    /// [`Error::Batch`] if it does not know an expert, or if the shapes do not fit; those of the GPU.
    pub fn weights(
        &self,
        experts: &[&str],
        inputs: ArrayView2<'_, f32>,
        closed: ArrayView2<'_, f32>,
    ) -> Result<Array2<f32>, Error> {
        let slots = self.slots(experts).map_err(Error::Batch)?;
        if inputs.nrows() != INPUTS || closed.dim() != (inputs.ncols(), experts.len()) {
            let (inputs, closed) = (inputs.dim(), closed.dim());
            return Err(Error::Batch(format!("{inputs:?} inputs, and weights of {closed:?}")));
        }
        let mut weights: Vec<_> = closed
            .rows()
            .into_iter()
            .map(|row| std::array::from_fn(|expert| row.get(expert).map_or(0.0, |w| (*w).into())))
            .collect();
        self.correct(&slots, inputs, &mut weights)?;
        Ok(Array2::from_shape_fn(closed.dim(), |(row, expert)| weights[row][expert] as f32))
    }

    /// Corrects the closed form's weights in rows of inputs, `[input][row]`.
    fn correct(
        &self,
        slots: &[usize],
        inputs: ArrayView2<'_, f32>,
        weights: &mut [[f64; MOST]],
    ) -> Result<(), Error> {
        let mut outputs = vec![[0.0_f32; MOST]; weights.len()];
        let mut out = vec![0.0; weights.len()];
        for (expert, slot) in slots.iter().enumerate() {
            self.outputs[*slot].evaluate(inputs, &mut out)?;
            outputs.iter_mut().zip(&out).for_each(|(outputs, out)| outputs[expert] = *out);
        }
        let (count, floor) = (slots.len(), f64::from(self.network.floor()));
        for (weights, outputs) in weights.iter_mut().zip(&outputs) {
            correct(&mut weights[..count], &outputs[..count], floor);
        }
        Ok(())
    }

    /// The slots of experts, or why they have none.
    fn slots(&self, experts: &[&str]) -> Result<Vec<usize>, String> {
        let known = self.network.experts();
        let slot = |name: &&str| {
            let slot = known.iter().position(|it| it == name);
            slot.ok_or_else(|| format!("it does not know '{name}'"))
        };
        experts.iter().map(slot).collect()
    }

    /// The network for experts of these names, for so many samples of pictures whose mean is
    /// `unit`; or why it cannot weigh them.
    pub(super) fn of(
        &self,
        names: &[&str],
        samples: f64,
        unit: f64,
    ) -> Result<Learned<'_>, String> {
        let slots = self.slots(names)?;
        let (least, most) = self.network.metadata().samples;
        if !(f64::from(least)..=f64::from(most)).contains(&samples) {
            return Err(format!("it knows {least} to {most} samples per pixel"));
        }
        Ok(Learned { mlp: self, slots, samples, unit })
    }
}

/// A network for the experts of a picture.
pub(super) struct Learned<'a> {
    mlp: &'a GuardMlp,
    slots: Vec<usize>,
    samples: f64,
    unit: f64,
}

impl Learned<'_> {
    /// How many samples each lane has.
    pub(super) fn samples(&self) -> f64 {
        self.samples
    }

    /// What the network reads of these sums.
    pub(super) fn inputs<'a>(&'a self, fits: &'a Fits<'a>) -> Inputs<'a> {
        Inputs::new(fits, &self.slots, self.unit)
    }

    /// The weights of a row of cells, `[column]`; those of the closed form in the dark, and where
    /// nothing is near.
    ///
    /// # Errors
    /// Those of the GPU.
    pub(super) fn weights(
        &self,
        inputs: &[Input],
        closed: &[OfCell],
    ) -> Result<Vec<OfCell>, Error> {
        let inputs: Vec<_> = inputs.iter().filter(|it| it.knot >= DARK).collect();
        let numbers =
            Array2::from_shape_fn((INPUTS, inputs.len()), |(i, at)| inputs[at].numbers[i]);
        let mut weights = closed.to_vec();
        let mut known: Vec<_> =
            inputs.iter().map(|it| weights[it.column][it.half][it.knot]).collect();
        self.mlp.correct(&self.slots, numbers.view(), &mut known)?;
        for (Input { column, half, knot, .. }, corrected) in inputs.into_iter().zip(known) {
            weights[*column][*half][*knot] = corrected;
        }
        Ok(weights)
    }
}

/// Corrects weights of the closed form by a network's outputs.
fn correct(weights: &mut [f64], outputs: &[f32], floor: f64) {
    let plain = (1.0 - weights.iter().sum::<f64>()).max(0.0) + floor;
    let mut sum = plain;
    for (weight, output) in weights.iter_mut().zip(outputs) {
        *weight = (weight.max(0.0) + floor) * f64::from(*output).exp();
        sum += *weight;
    }
    weights.iter_mut().for_each(|weight| *weight /= sum);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outputs_correct_weights() {
        let corrected = |mut weights: [f64; 2], outputs: [f32; 2]| {
            correct(&mut weights, &outputs, 0.02);
            weights
        };
        // Without outputs, weights come closer to each other by the floor alone.
        let [a, b] = corrected([0.5, 0.0], [0.0; 2]);
        assert!((a - 0.52 / 1.06).abs() < 1e-12 && (b - 0.02 / 1.06).abs() < 1e-12, "{a} {b}");
        let [more, less] = corrected([0.5, 0.0], [2.0_f32.ln(), 0.0]);
        assert!((more - 1.04 / 1.58).abs() < 1e-7 && less < b, "{more} {less}");
        // What is beyond 1 by rounding is no weight of S below 0.
        let [all, _] = corrected([1.0 + 1e-9, 0.0], [50.0, 0.0]);
        assert!(all <= 1.0 && all > 1.0 - 1e-9, "{all}");
    }
}
