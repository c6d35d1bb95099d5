//! The layers of networks on any processor.

use std::sync::Arc;

use ndarray::ArrayView2;

#[cfg(feature = "gpu")]
use crate::gpu::{Gpu, MlpGpu};
use crate::{Error, MlpCpu, Network};

/// Evaluates a network for rows of inputs, on the processor that it was made for.
#[derive(Debug)]
pub(crate) enum Evaluator {
    Cpu(MlpCpu),
    #[cfg(feature = "gpu")]
    Gpu(MlpGpu),
}

impl Evaluator {
    pub(crate) fn on_cpu(network: &Arc<Network>) -> Self {
        Self::Cpu(MlpCpu::new(Arc::clone(network)))
    }

    /// # Errors
    /// As for [`MlpGpu::new`].
    #[cfg(feature = "gpu")]
    pub(crate) fn on_gpu(network: &Arc<Network>, gpu: Gpu) -> Result<Self, Error> {
        Ok(Self::Gpu(MlpGpu::new(gpu, Arc::clone(network))?))
    }

    /// Evaluates all lanes of inputs `[input][lane]`.
    ///
    /// # Errors
    /// Those of the GPU.
    pub(crate) fn evaluate(
        &self,
        inputs: ArrayView2<'_, f32>,
        out: &mut [f32],
    ) -> Result<(), Error> {
        match self {
            Self::Cpu(mlp) => mlp.evaluate_all(inputs, out),
            #[cfg(feature = "gpu")]
            Self::Gpu(mlp) => mlp.evaluate_all(inputs, out)?,
        }
        Ok(())
    }
}
