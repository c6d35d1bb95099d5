//! The WGSL kernels: their sources, constants and data.

use bytemuck::{Pod, Zeroable};
use half::f16;

use super::{Cooperative, Gpu};
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
/// `SUBGROUPS` of `cooperative.wgsl`.
const SUBGROUPS: u32 = 8;
/// `WIDTH` of `cooperative.wgsl`.
const COOPERATIVE_WIDTH: u32 = 256;
/// `MAX_WINDOW` of `cooperative.wgsl`.
const COOPERATIVE_WINDOW: u32 = 32;

/// A way to evaluate a network in WGSL; all give the same results but for rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kernel {
    /// Tiles of 4 neurons × 16 lanes per invocation; activations in workgroup memory.
    #[default]
    Tiled,
    /// One lane per invocation, in private arrays: what the others are measured by.
    Naive,
    /// Matrices in f16 that a subgroup multiplies together, with sums in f32, where the
    /// adapter has them: experimental, with [`Precision::F16`], on a [`Gpu`] from
    /// [`Gpu::open_experimental`]. Refused if the results are wrong.
    Cooperative,
}

impl Kernel {
    /// `tiled`, `naive` or `cooperative`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tiled => "tiled",
            Self::Naive => "naive",
            Self::Cooperative => "cooperative",
        }
    }
}

/// How the GPU stores weights; sums are always f32, and so are activations but for those of
/// [`Kernel::Cooperative`].
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
    pub(super) kernel: Kernel,
    pub(super) constants: Vec<(&'static str, f64)>,
    pub(super) lanes_per_workgroup: u32,
    /// Of cooperative matrices, or 0.
    size: u32,
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
                Ok(Self { kernel, constants, lanes_per_workgroup: lanes, size: 0 })
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
                let lanes_per_workgroup = LANES_PER_GROUP * groups;
                Ok(Self { kernel, constants, lanes_per_workgroup, size: 0 })
            }
            Kernel::Cooperative => {
                let Some(Cooperative { size, subgroup }) = gpu.cooperative else {
                    return refuse("it has no cooperative matrices, or was opened without".into());
                };
                let deep = network.layers().len() > 1;
                if !deep || widest > COOPERATIVE_WIDTH || window > COOPERATIVE_WINDOW as usize {
                    return refuse(format!(
                        "the kernel takes hidden layers, one or more, of up to \
                         {COOPERATIVE_WIDTH} neurons, and windows of up to {COOPERATIVE_WINDOW}"
                    ));
                }
                let (lanes, threads) = (2 * size, subgroup * SUBGROUPS);
                let bytes =
                    lanes * (4 * COOPERATIVE_WINDOW + 2 * COOPERATIVE_WIDTH + 4 * size * SUBGROUPS);
                if memory < bytes || most < threads {
                    return refuse(format!(
                        "it has {memory} bytes of workgroup memory and {most} invocations, \
                         where {bytes} and {threads} are needed"
                    ));
                }
                let rounds = widest.div_ceil(size * SUBGROUPS);
                let constants =
                    vec![("SUBGROUP", f64::from(subgroup)), ("ROUNDS", f64::from(rounds))];
                Ok(Self { kernel, constants, lanes_per_workgroup: lanes, size })
            }
        }
    }

    pub(super) fn source(&self, precision: Precision) -> String {
        source(self.kernel, precision, self.size)
    }

    pub(super) fn pack(&self, network: &Network, precision: Precision) -> Result<Packed, Error> {
        if self.kernel == Kernel::Cooperative {
            pack_cooperative(network, self.size as usize)
        } else {
            pack(network, precision)
        }
    }
}

/// `size` is that of cooperative matrices.
fn source(kernel: Kernel, precision: Precision, size: u32) -> String {
    let head = match (kernel, precision) {
        (Kernel::Cooperative, _) => format!(
            "enable f16;\nenable wgpu_cooperative_matrix;\nalias Weights = f32;\n\
             const SIZE: u32 = {size};\n\
             alias Left = coop_mat{size}x{size}<f16, A>;   // [neuron][input]\n\
             alias Right = coop_mat{size}x{size}<f16, B>;  // [input][lane]\n\
             alias Sums = coop_mat{size}x{size}<f32, C>;   // [neuron][lane]"
        ),
        (_, Precision::F32) => "alias Weights = vec4<f32>;".to_owned(),
        (_, Precision::F16) => "enable f16;\nalias Weights = vec4<f16>;".to_owned(),
    };
    let kernel = match kernel {
        Kernel::Naive => include_str!("naive.wgsl"),
        Kernel::Tiled => include_str!("tiled.wgsl"),
        Kernel::Cooperative => include_str!("cooperative.wgsl"),
    };
    [&head, COMMON, kernel].join("\n")
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

/// The weights as a shader reads them.
pub(super) struct Packed {
    pub(super) layers: Vec<LayerTable>,
    /// The bytes of binding 2.
    pub(super) weights: Vec<u8>,
    /// The bytes of binding 5, of the cooperative kernel.
    pub(super) halves: Option<Vec<u8>>,
}

/// Per layer `[in][out]` and then the biases `[out]`, padded to blocks of four outputs.
fn pack(network: &Network, precision: Precision) -> Result<Packed, Error> {
    let mut packed = Vec::new();
    let layers = network.layers().iter().map(|layer| {
        let weights = packed.len() as u32 / 4;
        pack_matrix(layer, layer.inputs(), 4, &mut packed);
        let biases = packed.len() as u32 / 4;
        pack_biases(layer, 4, &mut packed);
        let blocks = layer.outputs().div_ceil(4) as u32;
        LayerTable { inputs: layer.inputs() as u32, blocks, weights, biases }
    });
    let layers = layers.collect();
    let weights = match precision {
        Precision::F32 => bytemuck::cast_slice(&packed).to_vec(),
        Precision::F16 => bytemuck::cast_slice(&to_f16(&packed)?).to_vec(),
    };
    Ok(Packed { layers, weights, halves: None })
}

/// All biases, and the weights of the first layer, in f32; the other weights in f16,
/// padded to blocks of `size` outputs and inputs. Biases are there once per lane of a
/// matrix, `[lane][out]`.
fn pack_cooperative(network: &Network, size: usize) -> Result<Packed, Error> {
    let (mut singles, mut halves) = (Vec::new(), Vec::new());
    let layers = network.layers().iter().enumerate().map(|(i, layer)| {
        let inputs = if i == 0 { layer.inputs() } else { layer.inputs().next_multiple_of(size) };
        let into = if i == 0 { &mut singles } else { &mut halves };
        let weights = into.len() as u32;
        pack_matrix(layer, inputs, size, into);
        let biases = singles.len() as u32;
        (0..size).for_each(|_| pack_biases(layer, size, &mut singles));
        let blocks = layer.outputs().div_ceil(size) as u32;
        LayerTable { inputs: inputs.div_ceil(size) as u32, blocks, weights, biases }
    });
    let layers = layers.collect();
    let halves = bytemuck::cast_slice(&to_f16(&halves)?).to_vec();
    Ok(Packed { layers, weights: bytemuck::cast_slice(&singles).to_vec(), halves: Some(halves) })
}

/// `[in][out]`, for so many inputs, and outputs padded with zeros to a multiple of `block`.
fn pack_matrix(layer: &Layer, inputs: usize, block: usize, packed: &mut Vec<f32>) {
    let outputs = layer.outputs().next_multiple_of(block);
    for k in 0..inputs {
        packed.extend((0..outputs).map(|o| layer.weight.get((o, k)).unwrap_or(&0.0)));
    }
}

/// `[out]`, padded alike.
fn pack_biases(layer: &Layer, block: usize, packed: &mut Vec<f32>) {
    let outputs = layer.outputs().next_multiple_of(block);
    packed.extend((0..outputs).map(|o| layer.bias.get(o).unwrap_or(&0.0)));
}

/// Packed weights in f16, or an error if one is too large for it.
fn to_f16(packed: &[f32]) -> Result<Vec<u16>, Error> {
    let rounded: Vec<_> = packed.iter().copied().map(f16::from_f32).collect();
    if rounded.iter().all(|weight| weight.is_finite()) {
        Ok(rounded.into_iter().map(f16::to_bits).collect())
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

    const KERNELS: [Kernel; 3] = [Kernel::Tiled, Kernel::Naive, Kernel::Cooperative];

    fn module(kernel: Kernel, precision: Precision, size: u32) -> naga::Module {
        parse(&source(kernel, precision, size)).expect("the shader parses")
    }

    fn parse(source: &str) -> Result<naga::Module, naga::front::wgsl::ParseError> {
        let capabilities = Capabilities::SHADER_FLOAT16 | Capabilities::COOPERATIVE_MATRIX;
        let options = naga::front::wgsl::Options { parse_doc_comments: false, capabilities };
        naga::front::wgsl::Frontend::new_with_options(options).parse(source)
    }

    fn is_valid(module: &naga::Module) -> bool {
        let capabilities = Capabilities::SHADER_FLOAT16 | Capabilities::COOPERATIVE_MATRIX;
        let mut validator = Validator::new(ValidationFlags::all(), capabilities);
        validator.validate(module).inspect_err(|error| eprintln!("{error:?}")).is_ok()
    }

    /// Needs no adapter.
    #[test]
    fn every_variant_is_valid() {
        for kernel in KERNELS {
            // Sizes are of cooperative matrices, precisions of the others.
            for (precision, size) in [(Precision::F32, 8), (Precision::F16, 16)] {
                let module = module(kernel, precision, size);
                assert!(is_valid(&module), "{kernel:?}, {precision:?}, {size}");
            }
            // A store to the input, which is read-only, must be noticed.
            let right = source(kernel, Precision::F32, 8);
            let broken = right.replace("estimates[", "terms[");
            assert_ne!(broken, right);
            assert!(!is_valid(&parse(&broken).expect("it still parses")));
        }
    }

    #[test]
    fn weights_beyond_f16_are_refused() {
        assert_eq!(to_f16(&[1.0, -2.0, 0.0, 65504.0]).ok().map(|w| w[0]), Some(0x3c00));
        assert!(to_f16(&[0.0, 0.0, 7e4, 0.0]).is_err());
    }

    /// Offsets and sizes as the shader compiler lays them out.
    #[test]
    fn structs_have_the_shaders_layout() {
        let module = module(Kernel::Tiled, Precision::F32, 0);
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
