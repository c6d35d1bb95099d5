// The network on the GPU, for software adapters: an invocation owns a lane, and the
// lanes of a vector unit read the same weights at once. For layers i = 0 … L−1:
//     a ← leaky_relu(W_i a + b_i), without the activation after the last one.
// No invocation reads what another has written, so there is no barrier.

// Invocations per workgroup.
override LANES: u32 = 8;
// Rows of each half of `activations`: the widest layer, a multiple of eight.
override WIDTH: u32 = 256;

// [half][neuron][lane of workgroup]; layers read one half and write the other.
var<workgroup> activations: array<f32, 2u * WIDTH * LANES>;

@compute @workgroup_size(LANES)
fn transform(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let lane = workgroup.x * LANES + thread;
    var front = thread;
    var back = WIDTH * LANES + thread;
    for (var t = 0u; t < params.window; t++) {
        activations[front + t * LANES] = term(t, lane);
    }

    for (var l = 0u; l < params.layers; l++) {
        let layer = layers[l];
        let slope = select(params.negative_slope, 1.0, l + 1u == params.layers);
        for (var block = 0u; block < layer.blocks; block += 2u) {
            // A layer with an odd number of blocks computes its last one twice.
            let second = min(block + 1u, layer.blocks - 1u);
            var sum_0 = weights_at(layer.biases + block);
            var sum_1 = weights_at(layer.biases + second);
            for (var k = 0u; k < layer.inputs; k++) {
                let a = activations[front + k * LANES];
                let row = layer.weights + k * layer.blocks;
                sum_0 += a * weights_at(row + block);
                sum_1 += a * weights_at(row + second);
            }
            sum_0 = leaky_relu(sum_0, slope);
            sum_1 = leaky_relu(sum_1, slope);
            let out = back + block * 4u * LANES;
            activations[out] = sum_0.x;
            activations[out + LANES] = sum_0.y;
            activations[out + 2u * LANES] = sum_0.z;
            activations[out + 3u * LANES] = sum_0.w;
            activations[out + 4u * LANES] = sum_1.x;
            activations[out + 5u * LANES] = sum_1.y;
            activations[out + 6u * LANES] = sum_1.z;
            activations[out + 7u * LANES] = sum_1.w;
        }
        let swap = front;
        front = back;
        back = swap;
    }
    // Neuron 0 of the last layer is the estimate.
    if lane < params.lanes {
        estimates[lane] = activations[front];
    }
}
