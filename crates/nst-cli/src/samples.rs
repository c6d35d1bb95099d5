//! Networks that see samples: where they run, and what they need.

#[cfg(feature = "gpu")]
use nst_core::gpu::{AdapterKind, Gpu};
use nst_core::{FOLDS, Power, Requirements, SampleMlp, SampleNetwork, Side};

use crate::{adapter::Adapter, args::BackendArg, error::Error};

/// A network with its layers where the command line wants them.
pub(crate) fn evaluated(
    name: String,
    network: SampleNetwork,
    backend: BackendArg,
    adapter: &Adapter,
) -> Result<SampleMlp, Error> {
    match backend {
        // Smaller than what a driver takes to load.
        BackendArg::Auto | BackendArg::Cpu => Ok(SampleMlp::new(name, network)),
        BackendArg::Gpu => on_gpu(name, network, adapter),
    }
}

#[cfg(feature = "gpu")]
fn on_gpu(name: String, network: SampleNetwork, adapter: &Adapter) -> Result<SampleMlp, Error> {
    adapter.open(|| {
        let gpu = Gpu::open(AdapterKind::Any)?;
        let gpu_name = gpu.name().to_owned();
        Ok((gpu_name, SampleMlp::on_gpu(name, network, gpu)?))
    })
}

#[cfg(not(feature = "gpu"))]
fn on_gpu(_: String, _: SampleNetwork, _: &Adapter) -> Result<SampleMlp, Error> {
    let message = "--backend gpu: this nst was built without the feature 'gpu'";
    Err(Error::Usage(message.into()))
}

/// What samples lack for a method that needs statistics of them.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Lack {
    /// Those of folds, which most files have.
    Folds,
    /// The means of these powers, which only files have that were made for them.
    Powers(Vec<Power>),
}

impl Lack {
    /// What sequences with these side channels lack, if anything.
    pub(crate) fn of(needs: &Requirements, sides: &[Side]) -> Option<Self> {
        if needs.sides.iter().any(|side| !sides.contains(side)) {
            return Some(Self::Folds);
        }
        let has = |power: &Power| Side::power_means(*power).iter().all(|it| sides.contains(it));
        let missing: Vec<Power> = needs.powers.iter().filter(|power| !has(power)).collect();
        (!missing.is_empty()).then_some(Self::Powers(missing))
    }

    /// What is lacking, and how to make a file that has it; `option` is that of the method.
    pub(crate) fn message(&self, option: &str) -> String {
        match self {
            Self::Folds => format!(
                "there are no means of the samples in folds, as of snapshots, early files, or fewer \
                 than {FOLDS} samples; 'nst render --sequence' stores them"
            ),
            Self::Powers(powers) => {
                let powers: Vec<_> = powers.iter().map(ToString::to_string).collect();
                format!(
                    "there are no means of the samples to the power {}; 'nst render --sequence' \
                     stores them if it is given {option}, too, from its first sample on",
                    powers.join(", ")
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nst_core::{Transform, guard::Alone};

    use super::*;
    use crate::networks::builtin_of_samples;

    #[test]
    fn what_is_lacking_is_named() -> Result<(), Error> {
        let needs = |name: &str| -> Result<Requirements, Error> {
            Ok(Alone::new(SampleMlp::new(name, builtin_of_samples(name)?)).requires())
        };
        let (small, gaussian) = (needs("small")?, needs("gaussian-samples")?);
        let usual = Side::EVERY_OF_FOLDS.to_vec();
        assert_eq!(Lack::of(&small, &usual), None);
        assert_eq!(Lack::of(&small, &usual[1..]), Some(Lack::Folds));
        assert_eq!(Lack::of(&gaussian, &[]), Some(Lack::Folds));
        let mut sides = gaussian.all_sides();
        assert_eq!(Lack::of(&gaussian, &sides), None);
        let last = sides.pop();
        assert!(matches!(last, Some(Side::PowerMean(power, 3)) if power.value() == 16.0));
        let lack = Lack::of(&gaussian, &sides).expect("a fold of a power is missing");
        let message = lack.message("--transform gaussian-samples");
        for word in ["to the power 16; ", "given --transform gaussian-samples"] {
            assert!(message.contains(word), "'{word}' is not in: {message}");
        }
        Ok(())
    }
}
