// The network by cooperative matrices of SIZE × SIZE, in f16 with sums in f32:
// experimental. Behind `alias Left`, `Right` and `Sums`, the three kinds of matrix, and
// `const SIZE`. The first layer is in f32, as f16 would erase the differences of terms.
//
// A workgroup has 2 · SIZE lanes, whose activations stay in its memory. Blocks of SIZE
// neurons go round the subgroups; each keeps the sums of its blocks in registers, until
// all have read the layer's inputs.

const LANES_PER_WORKGROUP: u32 = 2 * SIZE;
const WIDTH: u32 = 256;
const MAX_WINDOW: u32 = 32;
const SUBGROUPS: u32 = 8;
// Neurons per round of blocks.
const ROUND: u32 = SUBGROUPS * SIZE;

// Invocations per subgroup.
override SUBGROUP: u32 = 32;
// Rounds of blocks that the widest layer takes: at most WIDTH / ROUND, so at most four.
override ROUNDS: u32 = 4;

@group(0) @binding(5) var<storage, read> halves: array<f16>;  // per layer but the first: [in][out]

var<workgroup> window: array<f32, MAX_WINDOW * LANES_PER_WORKGROUP>;   // [term][lane]
var<workgroup> activations: array<f16, WIDTH * LANES_PER_WORKGROUP>;   // [neuron][lane]
var<workgroup> scratch: array<f32, ROUND * LANES_PER_WORKGROUP>;       // [neuron of a round][lane]

fn activate(x: f32) -> f16 {
    return f16(select(params.negative_slope * x, x, x > 0.0));
}

@compute @workgroup_size(SUBGROUP * SUBGROUPS)
fn transform(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let threads = SUBGROUP * SUBGROUPS;
    let subgroup = thread / SUBGROUP;
    let first_lane = workgroup.x * LANES_PER_WORKGROUP;

    for (var i = thread; i < params.window * LANES_PER_WORKGROUP; i += threads) {
        let lane = first_lane + i % LANES_PER_WORKGROUP;
        window[i] = term(i / LANES_PER_WORKGROUP, lane);
    }
    workgroupBarrier();

    let first = layers[0];
    for (var i = thread; i < first.blocks * SIZE * LANES_PER_WORKGROUP; i += threads) {
        let neuron = i / LANES_PER_WORKGROUP;
        var sum = weights[first.biases + neuron];
        for (var k = 0u; k < params.window; k++) {
            let value = window[k * LANES_PER_WORKGROUP + i % LANES_PER_WORKGROUP];
            sum += weights[first.weights + k * first.blocks * SIZE + neuron] * value;
        }
        activations[i] = activate(sum);
    }
    workgroupBarrier();

    for (var l = 1u; l < params.layers; l++) {
        let layer = layers[l];
        let neurons = layer.blocks * SIZE;
        // Cooperative operations must be in uniform control flow: subgroups without a block
        // in a round compute the last one again, into numbers that nothing reads.
        let last = layer.blocks - 1u;
        let row_0 = min(subgroup, last) * SIZE;
        let row_1 = min(subgroup + SUBGROUPS, last) * SIZE;
        let row_2 = min(subgroup + 2u * SUBGROUPS, last) * SIZE;
        let row_3 = min(subgroup + 3u * SUBGROUPS, last) * SIZE;

        // Of each round, the first lanes and the others. Biases are stored once per lane.
        var sums_00 = coopLoad<Sums>(&weights[layer.biases + row_0], neurons); var sums_01 = sums_00;
        var sums_10 = coopLoad<Sums>(&weights[layer.biases + row_1], neurons); var sums_11 = sums_10;
        var sums_20 = coopLoad<Sums>(&weights[layer.biases + row_2], neurons); var sums_21 = sums_20;
        var sums_30 = coopLoad<Sums>(&weights[layer.biases + row_3], neurons); var sums_31 = sums_30;
        for (var k = 0u; k < layer.inputs; k++) {
            let input = k * SIZE * LANES_PER_WORKGROUP;
            let right_0 = coopLoadT<Right>(&activations[input], LANES_PER_WORKGROUP);
            let right_1 = coopLoadT<Right>(&activations[input + SIZE], LANES_PER_WORKGROUP);
            let column = layer.weights + k * SIZE * neurons;
            let left_0 = coopLoad<Left>(&halves[column + row_0], neurons);
            sums_00 = coopMultiplyAdd(left_0, right_0, sums_00);
            sums_01 = coopMultiplyAdd(left_0, right_1, sums_01);
            if ROUNDS > 1u {
                let left_1 = coopLoad<Left>(&halves[column + row_1], neurons);
                sums_10 = coopMultiplyAdd(left_1, right_0, sums_10);
                sums_11 = coopMultiplyAdd(left_1, right_1, sums_11);
            }
            if ROUNDS > 2u {
                let left_2 = coopLoad<Left>(&halves[column + row_2], neurons);
                sums_20 = coopMultiplyAdd(left_2, right_0, sums_20);
                sums_21 = coopMultiplyAdd(left_2, right_1, sums_21);
            }
            if ROUNDS > 3u {
                let left_3 = coopLoad<Left>(&halves[column + row_3], neurons);
                sums_30 = coopMultiplyAdd(left_3, right_0, sums_30);
                sums_31 = coopMultiplyAdd(left_3, right_1, sums_31);
            }
        }

        let mine = subgroup * SIZE * LANES_PER_WORKGROUP;
        for (var round = 0u; round < ROUNDS; round++) {
            // All reads of this layer's inputs, and of the round before, are done.
            workgroupBarrier();
            var sums_0 = sums_00;
            var sums_1 = sums_01;
            switch round {
                case 1u: { sums_0 = sums_10; sums_1 = sums_11; }
                case 2u: { sums_0 = sums_20; sums_1 = sums_21; }
                case 3u: { sums_0 = sums_30; sums_1 = sums_31; }
                default: {}
            }
            coopStoreT(sums_0, &scratch[mine], LANES_PER_WORKGROUP);
            coopStoreT(sums_1, &scratch[mine + SIZE], LANES_PER_WORKGROUP);
            workgroupBarrier();
            for (var i = thread; i < ROUND * LANES_PER_WORKGROUP; i += threads) {
                activations[round * ROUND * LANES_PER_WORKGROUP + i] = activate(scratch[i]);
            }
            // Neuron 0 of the last layer is the estimate.
            let is_estimate = l + 1u == params.layers && round == 0u && thread < LANES_PER_WORKGROUP;
            if is_estimate && first_lane + thread < params.lanes {
                estimates[first_lane + thread] = scratch[thread];
            }
        }
        workgroupBarrier();
    }
}
