// The network on the GPU, for GPUs; its CPU twin is the module `mlp`. For layers
// i = 0 … L−1: a ← leaky_relu(W_i a + b_i), without the activation after the last one.
//
// A thread owns 4 neurons × 16 lanes, whose sums stay in registers. BLOCKS
// threads make up the widest layer of one group of 16 lanes, and GROUPS such groups
// share a workgroup. On a GPU, BLOCKS · GROUPS is 64: activations take 16 KiB, the
// least that WebGPU guarantees.

const LANES_PER_GROUP: u32 = 16;

// Blocks of four neurons in the widest layer: a power of two, at most 64.
override BLOCKS: u32 = 64;
override GROUPS: u32 = 1;

// [group of 16 lanes][neuron][lanes / 4]
var<workgroup> activations: array<vec4<f32>, BLOCKS * GROUPS * LANES_PER_GROUP>;

@compute @workgroup_size(BLOCKS * GROUPS)
fn transform(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let block = thread % BLOCKS;
    // That one group needs no division lets compilers see that its loads are uniform.
    let group = select(thread / BLOCKS, 0u, GROUPS == 1u);
    let first_lane = (workgroup.x * GROUPS + group) * LANES_PER_GROUP;
    let base = group * BLOCKS * 16u;

    for (var i = block; i < params.window * 4u; i += BLOCKS) {
        let t = i / 4u;
        let lane = first_lane + (i % 4u) * 4u;
        activations[base + i] =
            vec4(term(t, lane), term(t, lane + 1u), term(t, lane + 2u), term(t, lane + 3u));
    }
    workgroupBarrier();

    for (var l = 0u; l < params.layers; l++) {
        let layer = layers[l];
        let slope = select(params.negative_slope, 1.0, l + 1u == params.layers);

        // sum_jv: neuron j of the block, lanes 4v … 4v + 3 of the group.
        var sum_00 = vec4(0.0); var sum_01 = vec4(0.0); var sum_02 = vec4(0.0); var sum_03 = vec4(0.0);
        var sum_10 = vec4(0.0); var sum_11 = vec4(0.0); var sum_12 = vec4(0.0); var sum_13 = vec4(0.0);
        var sum_20 = vec4(0.0); var sum_21 = vec4(0.0); var sum_22 = vec4(0.0); var sum_23 = vec4(0.0);
        var sum_30 = vec4(0.0); var sum_31 = vec4(0.0); var sum_32 = vec4(0.0); var sum_33 = vec4(0.0);
        if block < layer.blocks {
            for (var k = 0u; k < layer.inputs; k++) {
                let w = weights_at(layer.weights + k * layer.blocks + block);
                let a0 = activations[base + k * 4u];
                let a1 = activations[base + k * 4u + 1u];
                let a2 = activations[base + k * 4u + 2u];
                let a3 = activations[base + k * 4u + 3u];
                sum_00 += w.x * a0; sum_01 += w.x * a1; sum_02 += w.x * a2; sum_03 += w.x * a3;
                sum_10 += w.y * a0; sum_11 += w.y * a1; sum_12 += w.y * a2; sum_13 += w.y * a3;
                sum_20 += w.z * a0; sum_21 += w.z * a1; sum_22 += w.z * a2; sum_23 += w.z * a3;
                sum_30 += w.w * a0; sum_31 += w.w * a1; sum_32 += w.w * a2; sum_33 += w.w * a3;
            }
        }
        // All reads of this layer's inputs come before the writes of its outputs.
        workgroupBarrier();
        if block < layer.blocks {
            let b = weights_at(layer.biases + block);
            let out = base + block * 16u;
            activations[out] = leaky_relu(sum_00 + b.x, slope);
            activations[out + 1u] = leaky_relu(sum_01 + b.x, slope);
            activations[out + 2u] = leaky_relu(sum_02 + b.x, slope);
            activations[out + 3u] = leaky_relu(sum_03 + b.x, slope);
            activations[out + 4u] = leaky_relu(sum_10 + b.y, slope);
            activations[out + 5u] = leaky_relu(sum_11 + b.y, slope);
            activations[out + 6u] = leaky_relu(sum_12 + b.y, slope);
            activations[out + 7u] = leaky_relu(sum_13 + b.y, slope);
            activations[out + 8u] = leaky_relu(sum_20 + b.z, slope);
            activations[out + 9u] = leaky_relu(sum_21 + b.z, slope);
            activations[out + 10u] = leaky_relu(sum_22 + b.z, slope);
            activations[out + 11u] = leaky_relu(sum_23 + b.z, slope);
            activations[out + 12u] = leaky_relu(sum_30 + b.w, slope);
            activations[out + 13u] = leaky_relu(sum_31 + b.w, slope);
            activations[out + 14u] = leaky_relu(sum_32 + b.w, slope);
            activations[out + 15u] = leaky_relu(sum_33 + b.w, slope);
        }
        workgroupBarrier();
    }

    // Neuron 0 of the last layer is the estimate.
    for (var i = block; i < LANES_PER_GROUP; i += BLOCKS) {
        if first_lane + i < params.lanes {
            estimates[first_lane + i] = activations[base + i / 4u][i % 4u];
        }
    }
}
