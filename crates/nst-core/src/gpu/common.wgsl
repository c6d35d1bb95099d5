// What the kernels share: the bindings, and the network's parts. Shaders are this
// file and one kernel's, behind `alias Weights = vec4<f32>;` or `vec4<f16>`.

struct Params {
    lanes: u32,           // lanes of this dispatch
    window: u32,          // terms per lane
    layers: u32,
    negative_slope: f32,
}

struct Layer {
    inputs: u32,
    blocks: u32,          // outputs / 4, rounded up
    weights: u32,         // index of the first weight in `weights`
    biases: u32,          // index of the first bias in `weights`
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> layers: array<Layer>;         // [layer]
@group(0) @binding(2) var<storage, read> weights: array<Weights>;       // per layer: [in][out / 4], then [out / 4]
@group(0) @binding(3) var<storage, read> terms: array<f32>;            // [term][lane]
@group(0) @binding(4) var<storage, read_write> estimates: array<f32>;  // [lane]

fn term(t: u32, lane: u32) -> f32 {
    if lane >= params.lanes {
        return 0.0;
    }
    return terms[t * params.lanes + lane];
}

fn leaky_relu(x: vec4<f32>, slope: f32) -> vec4<f32> {
    return select(slope * x, x, x > vec4(0.0));
}

// Four outputs' weights, or biases, in f32 whatever they are stored in.
fn weights_at(i: u32) -> vec4<f32> {
    return vec4<f32>(weights[i]);
}
