//! The WGSL kernels: their sources, and the constants that suit an adapter and a network.

use super::{
    device::{Cooperative, Gpu},
    options::{Kernel, Precision},
    pack::{Packed, pack, pack_cooperative},
};
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

/// A kernel with its constants, for an adapter and a network.
pub(super) struct Variant {
    pub(super) kernel: Kernel,
    pub(super) precision: Precision,
    pub(super) constants: Vec<(&'static str, f64)>,
    pub(super) lanes_per_workgroup: u32,
    /// Of cooperative matrices, or 0.
    size: u32,
}

impl Variant {
    /// # Errors
    /// [`Error::Gpu`] if the adapter lacks what the kernel, the precision or the network needs.
    pub(super) fn new(
        gpu: &Gpu,
        network: &Network,
        kernel: Kernel,
        precision: Precision,
    ) -> Result<Self, Error> {
        if kernel == Kernel::Cooperative && precision != Precision::F16 {
            return Err(Error::Gpu("cooperative matrices are in f16 only".into()));
        }
        if precision == Precision::F16 && !gpu.has_f16() {
            return Err(gpu.error("it has no f16"));
        }
        let shape = Widths::of(network);
        let constants = match kernel {
            Kernel::Tiled => tiled(gpu, shape),
            Kernel::Naive => naive(gpu, shape),
            Kernel::Cooperative => cooperative(gpu, shape),
        };
        let Constants { constants, lanes_per_workgroup, size } = constants.map_err(|why| {
            gpu.error(format!("cannot run a network of {}: {why}", network.shape()))
        })?;
        Ok(Self { kernel, precision, constants, lanes_per_workgroup, size })
    }

    pub(super) fn source(&self) -> String {
        source(self.kernel, self.precision, self.size)
    }

    pub(super) fn pack(&self, network: &Network) -> Result<Packed, Error> {
        if self.kernel == Kernel::Cooperative {
            pack_cooperative(network, self.size as usize)
        } else {
            pack(network, self.precision)
        }
    }
}

/// What a kernel must know of a network's shape.
#[derive(Clone, Copy)]
struct Widths {
    window: u32,
    /// Of the window and the layers.
    widest: u32,
    layers: usize,
}

impl Widths {
    fn of(network: &Network) -> Self {
        let window = network.metadata().window;
        let widest = network.layers().iter().map(Layer::outputs).fold(window, usize::max);
        Self { window: window as u32, widest: widest as u32, layers: network.layers().len() }
    }
}

/// The `override`s of a kernel's source, and what follows from them.
struct Constants {
    constants: Vec<(&'static str, f64)>,
    lanes_per_workgroup: u32,
    /// Of cooperative matrices, or 0.
    size: u32,
}

fn naive(gpu: &Gpu, Widths { widest, .. }: Widths) -> Result<Constants, String> {
    if widest > NAIVE_WIDTH {
        return Err(format!("the kernel takes widths of up to {NAIVE_WIDTH}"));
    }
    let lanes = NAIVE_LANES.min(most_invocations(gpu));
    let constants = vec![("LANES", f64::from(lanes))];
    Ok(Constants { constants, lanes_per_workgroup: lanes, size: 0 })
}

fn tiled(gpu: &Gpu, Widths { widest, .. }: Widths) -> Result<Constants, String> {
    let blocks = widest.div_ceil(4).next_power_of_two();
    if blocks > THREADS {
        return Err(format!("the kernel takes widths of up to {}", 4 * THREADS));
    }
    // A software adapter has no warps to fill, and is faster with uniform loads.
    let groups = if gpu.is_software() { 1 } else { THREADS / blocks };
    let threads = blocks * groups;
    check_limits(gpu, TILED_BYTES * threads, threads)?;
    let constants = vec![("BLOCKS", f64::from(blocks)), ("GROUPS", f64::from(groups))];
    Ok(Constants { constants, lanes_per_workgroup: LANES_PER_GROUP * groups, size: 0 })
}

fn cooperative(gpu: &Gpu, shape: Widths) -> Result<Constants, String> {
    let Widths { window, widest, layers } = shape;
    let Some(Cooperative { size, subgroup }) = gpu.cooperative else {
        return Err("it has no cooperative matrices, or was opened without".into());
    };
    if layers < 2 || widest > COOPERATIVE_WIDTH || window > COOPERATIVE_WINDOW {
        return Err(format!(
            "the kernel takes hidden layers, one or more, of up to {COOPERATIVE_WIDTH} neurons, \
             and windows of up to {COOPERATIVE_WINDOW}"
        ));
    }
    let (lanes, threads) = (2 * size, subgroup * SUBGROUPS);
    let bytes = lanes * (4 * COOPERATIVE_WINDOW + 2 * COOPERATIVE_WIDTH + 4 * size * SUBGROUPS);
    check_limits(gpu, bytes, threads)?;
    let rounds = widest.div_ceil(size * SUBGROUPS);
    let constants = vec![("SUBGROUP", f64::from(subgroup)), ("ROUNDS", f64::from(rounds))];
    Ok(Constants { constants, lanes_per_workgroup: lanes, size })
}

/// Fails if a workgroup may not have that much memory, or that many invocations.
fn check_limits(gpu: &Gpu, bytes: u32, threads: u32) -> Result<(), String> {
    let memory = gpu.device.limits().max_compute_workgroup_storage_size;
    let most = most_invocations(gpu);
    if memory < bytes || most < threads {
        return Err(format!(
            "it has {memory} bytes of workgroup memory and {most} invocations, \
             where {bytes} and {threads} are needed"
        ));
    }
    Ok(())
}

/// Per workgroup.
fn most_invocations(gpu: &Gpu) -> u32 {
    let limits = gpu.device.limits();
    limits.max_compute_invocations_per_workgroup.min(limits.max_compute_workgroup_size_x)
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

#[cfg(test)]
pub(super) mod tests {
    use naga::{
        TypeInner,
        valid::{Capabilities, ValidationFlags, Validator},
    };

    use super::*;
    use crate::gpu::pack::{LayerTable, Params};

    const KERNELS: [Kernel; 3] = [Kernel::Tiled, Kernel::Naive, Kernel::Cooperative];

    fn module(kernel: Kernel, precision: Precision, size: u32) -> naga::Module {
        parse(&source(kernel, precision, size)).expect("the shader parses")
    }

    fn parse(source: &str) -> Result<naga::Module, naga::front::wgsl::ParseError> {
        let capabilities = Capabilities::SHADER_FLOAT16 | Capabilities::COOPERATIVE_MATRIX;
        let options = naga::front::wgsl::Options { parse_doc_comments: false, capabilities };
        naga::front::wgsl::Frontend::new_with_options(options).parse(source)
    }

    /// Whether the source of a shader parses, and is valid.
    pub(in crate::gpu) fn is_valid_shader(source: &str) -> bool {
        parse(source).is_ok_and(|module| is_valid(&module))
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
    }

    /// Rust's constants are those of the sources.
    #[test]
    fn constants_are_the_shaders() {
        for (kernel, expected) in [
            (Kernel::Tiled, &[("LANES_PER_GROUP", LANES_PER_GROUP)][..]),
            (Kernel::Naive, &[("WIDTH", NAIVE_WIDTH)]),
            (
                Kernel::Cooperative,
                &[
                    ("WIDTH", COOPERATIVE_WIDTH),
                    ("MAX_WINDOW", COOPERATIVE_WINDOW),
                    ("SUBGROUPS", SUBGROUPS),
                ],
            ),
        ] {
            let module = module(kernel, Precision::F32, 8);
            for &(name, value) in expected {
                let named = |constant: &naga::Constant| constant.name.as_deref() == Some(name);
                let found = module.constants.iter().find(|(_, constant)| named(constant));
                let (_, constant) = found.expect(name);
                let init = &module.global_expressions[constant.init];
                let is =
                    matches!(init, naga::Expression::Literal(naga::Literal::U32(x)) if *x == value);
                assert!(is, "{kernel}: {name} is {init:?}, not {value}");
            }
        }
    }
}
