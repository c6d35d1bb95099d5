// The filter, one pixel per invocation: the twin of the loops in `filter/kernel.rs`, over the
// same planes.

struct Params {
    width: u32,
    stride: u32,          // of a row of a plane
    planes: u32,          // per row
    rows: u32,            // of `planes`
    first: u32,           // the row of `planes` that is the first of `means`
    count: u32,           // rows of `means`
    channels: u32,
}

override SIDE: u32 = 8;      // of a workgroup
override CHANNELS: u32 = 3;  // that are tested together: 1 or 3
override GUIDES: u32 = 6;    // 0, 3 or 6

const RADIUS: i32 = 10;
const SPREAD: f32 = 400.0;   // 8 · 2 σ² of the distance
const OF_CHANNEL: u32 = 3;   // mean, mean root, −t² v
const ROOT: u32 = 1;
const NOISE: u32 = 2;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> planes: array<f32>;       // [row][plane][column]
@group(0) @binding(2) var<storage, read_write> means: array<f32>;  // [channel][row][column]

fn at(pixel: u32, plane: u32) -> f32 {
    return planes[pixel + plane * params.stride];
}

@compute @workgroup_size(SIDE, SIDE)
fn transform(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.width || id.y >= params.count {
        return;
    }
    let y = i32(params.first + id.y);
    let of_row = params.planes * params.stride;
    let here = u32(y) * of_row + u32(RADIUS) + id.x;
    let first = id.z * CHANNELS;
    let guides = OF_CHANNEL * params.channels;

    var own_roots: array<f32, 3>;
    var own_noises: array<f32, 3>;
    var sums: array<f32, 3>;
    for (var c = 0u; c < CHANNELS; c++) {
        own_roots[c] = at(here, (first + c) * OF_CHANNEL + ROOT);
        own_noises[c] = at(here, (first + c) * OF_CHANNEL + NOISE);
    }
    var own_guides: array<f32, 6>;
    for (var g = 0u; g < GUIDES; g++) {
        own_guides[g] = -2.0 * at(here, guides + g);
    }
    var own_guide_noise = 0.0;
    if GUIDES > 0u {
        own_guide_noise = at(here, guides + GUIDES);
    }
    var total = 0.0;
    for (var dy = max(-RADIUS, -y); dy <= min(RADIUS, i32(params.rows) - 1 - y); dy++) {
        for (var dx = -RADIUS; dx <= RADIUS; dx++) {
            let squares = dx * dx + dy * dy;
            if squares > RADIUS * RADIUS {
                continue;
            }
            let there = u32(i32(here) + dy * i32(of_row) + dx);
            var alike = true;
            for (var c = 0u; c < CHANNELS; c++) {
                let d = own_roots[c] - at(there, (first + c) * OF_CHANNEL + ROOT);
                let noise = own_noises[c] + at(there, (first + c) * OF_CHANNEL + NOISE);
                alike = alike && d * d + noise <= 0.0;
            }
            if !alike {
                continue;
            }
            var far = f32(squares) / SPREAD - 1.0;
            if GUIDES > 0u {
                // What may be noise does not tell pixels apart.
                var differ = own_guide_noise + at(there, guides + GUIDES);
                for (var g = 0u; g < GUIDES; g++) {
                    differ += own_guides[g] * at(there, guides + g);
                }
                far += max(differ, 0.0);
            }
            let near = min(far, 0.0);
            let square = near * near;
            let fourth = square * square;
            let weight = fourth * fourth;
            total += weight;
            for (var c = 0u; c < CHANNELS; c++) {
                sums[c] += weight * at(there, (first + c) * OF_CHANNEL);
            }
        }
    }
    // Where the pixel itself does not count, what is there stays: no number.
    if total > 0.0 {
        for (var c = 0u; c < CHANNELS; c++) {
            means[((first + c) * params.count + id.y) * params.width + id.x] = sums[c] / total;
        }
    }
}
