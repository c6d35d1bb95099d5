//! The WGSL kernels: their sources, constants and data.

use bytemuck::{Pod, Zeroable};
use half::f16;

use super::Gpu;
use crate::{Error, Layer, Network};

const COMMON: &str = include_str!("common.wgsl");

/// Invocations per workgroup of `tiled.wgsl`, and the most blocks of four neurons: no
/// layer may be wider than 256.
const THREADS: u32 = 64;
/// `LANES_PER_GROUP` of `tiled.wgsl`.
const LANES_PER_GROUP: u32 = 16;
/// Bytes of workgroup memory that `tiled.wgsl` takes per invocation.
const TILED_BYTES: u32 = 4 * 4 * LANES_PER_GROUP;
/// `WIDTH` of `naive.wgsl`.
const NAIVE_WIDTH: u32 = 256;
/// `LANES` of `naive.wgsl`.
const NAIVE_LANES: u32 = 64;
/// A way to evaluate a network in WGSL; both give the same results but for rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kernel {
    /// Tiles of 4 neurons × 16 lanes per invocation; activations in workgroup memory.
    #[default]
    Tiled,
    /// One lane per invocation, in private arrays: what the other is measured by.
    Naive,
}

impl Kernel {
    /// `tiled` or `naive`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tiled => "tiled",
            Self::Naive => "naive",
        }
    }
}

/// How the GPU stores weights; sums and activations are always f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// As they are.
    #[default]
    F32,
    /// Rounded to f16: half the memory traffic, relative errors of some 10⁻³. Needs
    /// [`Gpu::has_f16`], and weights below 65,520.
    F16,
}

impl Precision {
    /// `f32` or `f16`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::F16 => "f16",
        }
    }
}

/// A kernel with its constants, for an adapter and a network.
pub(super) struct Variant {
    kernel: Kernel,
    pub(super) constants: Vec<(&'static str, f64)>,
    pub(super) lanes_per_workgroup: u32,
}

impl Variant {
    pub(super) fn new(gpu: &Gpu, network: &Network, kernel: Kernel) -> Result<Self, Error> {
        let window = network.metadata().window;
        let widest = network.layers().iter().map(Layer::outputs).fold(window, usize::max) as u32;
        let limits = gpu.device.limits();
        let memory = limits.max_compute_workgroup_storage_size;
        let most =
            limits.max_compute_invocations_per_workgroup.min(limits.max_compute_workgroup_size_x);
        let refuse = |why: String| {
            let shape = network.shape();
            Err(Error::Gpu(format!("{}: cannot run a network of {shape}: {why}", gpu.name)))
        };
        match kernel {
            Kernel::Naive if widest > NAIVE_WIDTH => {
                refuse(format!("the kernel takes widths of up to {NAIVE_WIDTH}"))
            }
            Kernel::Naive => {
                let lanes = NAIVE_LANES.min(most);
                let constants = vec![("LANES", f64::from(lanes))];
                Ok(Self { kernel, constants, lanes_per_workgroup: lanes })
            }
            Kernel::Tiled => {
                let blocks = widest.div_ceil(4).next_power_of_two();
                if blocks > THREADS {
                    return refuse(format!("the kernel takes widths of up to {}", 4 * THREADS));
                }
                // A software adapter has no warps to fill, and is faster with uniform loads.
                let groups = if gpu.is_software() { 1 } else { THREADS / blocks };
                let threads = blocks * groups;
                if memory < TILED_BYTES * threads || most < threads {
                    return refuse(format!(
                        "it has {memory} bytes of workgroup memory and {most} invocations, \
                         where {} and {threads} are needed",
                        TILED_BYTES * threads
                    ));
                }
                let constants = vec![("BLOCKS", f64::from(blocks)), ("GROUPS", f64::from(groups))];
                Ok(Self { kernel, constants, lanes_per_workgroup: LANES_PER_GROUP * groups })
            }
        }
    }

    pub(super) fn source(&self, precision: Precision) -> String {
        source(self.kernel, precision)
    }
}

fn source(kernel: Kernel, precision: Precision) -> String {
    let head = match precision {
        Precision::F32 => "alias Weights = vec4<f32>;",
        Precision::F16 => "enable f16;\nalias Weights = vec4<f16>;",
    };
    let kernel = match kernel {
        Kernel::Naive => include_str!("naive.wgsl"),
        Kernel::Tiled => include_str!("tiled.wgsl"),
    };
    [head, COMMON, kernel].join("\n")
}

/// `Params` of the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct Params {
    pub(super) lanes: u32,
    pub(super) window: u32,
    pub(super) layers: u32,
    pub(super) negative_slope: f32,
}

/// `Layer` of the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct LayerTable {
    inputs: u32,
    blocks: u32,
    weights: u32,
    biases: u32,
}

/// The weights as the shader reads them: per layer `[in][out / 4]` and then the
/// biases `[out / 4]`, in vectors of four outputs padded with zeros.
pub(super) fn pack(network: &Network) -> (Vec<LayerTable>, Vec<[f32; 4]>) {
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

/// Packed weights in f16, or an error if one is too large for it.
pub(super) fn pack_f16(packed: &[[f32; 4]]) -> Result<Vec<[u16; 4]>, Error> {
    let rounded: Vec<_> = packed.iter().map(|weights| weights.map(f16::from_f32)).collect();
    if rounded.iter().flatten().all(|weight| weight.is_finite()) {
        Ok(rounded.iter().map(|weights| weights.map(f16::to_bits)).collect())
    } else {
        Err(Error::Gpu("a weight is too large for f16; use f32".into()))
    }
}

#[cfg(test)]
mod tests {
    use naga::{
        TypeInner,
        valid::{Capabilities, ValidationFlags, Validator},
    };

    use super::*;

    const KERNELS: [Kernel; 2] = [Kernel::Tiled, Kernel::Naive];

    fn module(kernel: Kernel, precision: Precision) -> naga::Module {
        let source = source(kernel, precision);
        naga::front::wgsl::parse_str(&source).expect("the shader parses")
    }

    fn is_valid(module: &naga::Module) -> bool {
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::SHADER_FLOAT16);
        validator.validate(module).inspect_err(|error| eprintln!("{error:?}")).is_ok()
    }

    /// Needs no adapter.
    #[test]
    fn every_variant_is_valid() {
        for kernel in KERNELS {
            for precision in [Precision::F32, Precision::F16] {
                assert!(is_valid(&module(kernel, precision)), "{kernel:?}, {precision:?}");
            }
            // A store to the input, which is read-only, must be noticed.
            let right = source(kernel, Precision::F32);
            let broken = right.replace("estimates[", "terms[");
            assert_ne!(broken, right);
            assert!(!is_valid(&naga::front::wgsl::parse_str(&broken).expect("it still parses")));
        }
    }

    #[test]
    fn weights_beyond_f16_are_refused() {
        assert_eq!(pack_f16(&[[1.0, -2.0, 0.0, 65504.0]]).ok().map(|w| w[0][0]), Some(0x3c00));
        assert!(pack_f16(&[[0.0, 0.0, 7e4, 0.0]]).is_err());
    }

    /// Offsets and sizes as the shader compiler lays them out.
    #[test]
    fn structs_have_the_shaders_layout() {
        let module = module(Kernel::Tiled, Precision::F32);
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
        let lanes = ("LANES_PER_GROUP".to_owned(), LANES_PER_GROUP);
        assert!(constants.contains(&lanes), "{constants:?}");
    }
}
