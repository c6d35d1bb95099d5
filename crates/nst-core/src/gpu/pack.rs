//! What the kernels read: the parameters, and the weights in their order.

use bytemuck::{Pod, Zeroable};
use half::f16;

use super::options::Precision;
use crate::{Error, Layer, Network};

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
    pub(super) inputs: u32,
    pub(super) blocks: u32,
    pub(super) weights: u32,
    pub(super) biases: u32,
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
pub(super) fn pack(network: &Network, precision: Precision) -> Result<Packed, Error> {
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
pub(super) fn pack_cooperative(network: &Network, size: usize) -> Result<Packed, Error> {
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

/// `[in][out]`, for the given number of inputs, and with outputs padded with zeros to a multiple of `block`.
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
    use super::*;

    #[test]
    fn weights_beyond_f16_are_refused() {
        assert_eq!(to_f16(&[1.0, -2.0, 0.0, 65504.0]).ok().map(|w| w[0]), Some(0x3c00));
        assert!(to_f16(&[0.0, 0.0, 7e4, 0.0]).is_err());
    }
}
