//! Networks that see power means of a lane's samples instead of a window of terms.
//!
//! Of the samples of a lane, with the [power means](Power) M_p of its powers p_1 < … < p_K, the
//! plain estimate S, and the unit u, which is the mean of |S| over all lanes of the batch,
//!
//! ```text
//! L_p = ln(M_p/u + floor),
//! inputs:  L_1,  L_{p_2} − L_{p_1}, …, L_{p_K} − L_{p_{K−1}},  ln k,  1/k,
//! T = S + s·o,   s = scale_estimate·|S| + scale_unit·u,
//! ```
//!
//! where o is the network's output, and k is the number n of samples, or the nearest that it
//! was trained on. So T has the unit of the samples: T(aS) = a T(S) for a > 0.

use std::sync::Arc;

use super::model::{Layer, Metadata, Network};
use crate::{Error, Power};

/// What a [`SampleNetwork`] makes of the samples, and of its output: equations above.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleForm {
    /// Ascending, 1 among them.
    pub powers: Vec<Power>,
    /// What L does not tell from 0, in units of u; above 0.
    pub floor: f64,
    /// What an output of 1 adds to S, relative to |S|; at least 0.
    pub scale_estimate: f64,
    /// The same, in units of u; at least 0, and above 0 if `scale_estimate` is 0.
    pub scale_unit: f64,
}

impl SampleForm {
    /// The number of inputs of the first layer.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.powers.len() + 2
    }

    fn check(&self) -> Result<(), Error> {
        let Self { powers, floor, scale_estimate, scale_unit } = self;
        let not = |key: &str, what: &str| Err(Error::Weights(format!("'{key}' must be {what}")));
        let scale = |x: f64| (0.0..f64::INFINITY).contains(&x);
        if !powers.is_sorted_by(|a, b| a < b) || !powers.contains(&Power::ONE) {
            not("powers", "ascending, with 1 among them")
        } else if !(*floor > 0.0 && floor.is_finite()) {
            not("floor", "above 0")
        } else if !scale(*scale_estimate) {
            not("scale_estimate", "at least 0")
        } else if !scale(*scale_unit) || scale_estimate + scale_unit == 0.0 {
            not("scale_unit", "at least 0, and above 0 if 'scale_estimate' is 0")
        } else {
            Ok(())
        }
    }
}

/// A multi-layer perceptron that maps power means of a lane's samples to a change of the plain
/// estimate. It is evaluated by a [`SampleMlp`](crate::SampleMlp), an expert of the
/// [guard](crate::guard::Guard): outside of what it was trained on it may be far worse than the
/// plain estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleNetwork {
    /// Whose window is the inputs.
    layers: Arc<Network>,
    form: SampleForm,
}

impl SampleNetwork {
    /// Puts a network together. The metadata's window must be the number of inputs.
    ///
    /// # Errors
    /// [`Error::Weights`] as for [`Network::new`], or if the form is not as its fields say.
    pub fn new(layers: Vec<Layer>, metadata: Metadata, form: SampleForm) -> Result<Self, Error> {
        form.check()?;
        if metadata.window != form.inputs() {
            let (window, inputs) = (metadata.window, form.inputs());
            let message = format!("a window of {window} for a form of {inputs} inputs");
            return Err(Error::Weights(message));
        }
        Ok(Self { layers: Arc::new(Network::new(layers, metadata)?), form })
    }

    /// What it makes of the samples.
    #[must_use]
    pub fn form(&self) -> &SampleForm {
        &self.form
    }

    /// What the weights file says about the network.
    #[must_use]
    pub fn metadata(&self) -> &Metadata {
        self.layers.metadata()
    }

    /// The layers, as a network whose window is the inputs.
    #[must_use]
    pub fn layers(&self) -> &Arc<Network> {
        &self.layers
    }

    /// The inputs of a lane, from M_p of each power, n and u.
    pub(crate) fn inputs(
        &self,
        means: impl Iterator<Item = f64>,
        samples: f64,
        unit: f64,
        out: &mut [f32],
    ) {
        let SampleForm { powers, floor, .. } = &self.form;
        let count = powers.len();
        let mut before = 0.0;
        for (i, (&power, mean)) in powers.iter().zip(means).enumerate() {
            let log = (mean / unit + floor).ln();
            if power == Power::ONE {
                out[0] = log as f32;
            }
            if i > 0 {
                out[i] = (log - before) as f32;
            }
            before = log;
        }
        let (least, most) = self.metadata().samples;
        let k = samples.clamp(least.into(), most.into());
        (out[count], out[count + 1]) = (k.ln() as f32, k.recip() as f32);
    }

    /// s, what an output of 1 adds to S.
    pub(crate) fn scale(&self, plain: f64, unit: f64) -> f64 {
        let SampleForm { scale_estimate, scale_unit, .. } = self.form;
        scale_estimate * plain.abs() + scale_unit * unit
    }
}
