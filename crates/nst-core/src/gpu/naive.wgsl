// The network as its definition says, one lane per invocation: what the tiled
// kernel is compared with.

override LANES: u32 = 64;
const WIDTH: u32 = 256;

@compute @workgroup_size(LANES)
fn transform(@builtin(global_invocation_id) id: vec3<u32>) {
    let lane = id.x;
    var front: array<f32, WIDTH>;
    var back: array<f32, WIDTH>;
    for (var t = 0u; t < params.window; t++) {
        front[t] = term(t, lane);
    }
    for (var l = 0u; l < params.layers; l++) {
        let layer = layers[l];
        let slope = select(params.negative_slope, 1.0, l + 1u == params.layers);
        for (var block = 0u; block < layer.blocks; block++) {
            var sum = weights_at(layer.biases + block);
            for (var k = 0u; k < layer.inputs; k++) {
                sum += front[k] * weights_at(layer.weights + k * layer.blocks + block);
            }
            sum = leaky_relu(sum, slope);
            for (var j = 0u; j < 4u; j++) {
                back[4u * block + j] = sum[j];
            }
        }
        front = back;
    }
    if lane < params.lanes {
        estimates[lane] = front[0];
    }
}
