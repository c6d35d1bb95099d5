"""The same networks by `nst` and by what else evaluates them, on random inputs.

    python tests/peers/inference.py -o docs/inference.csv
    python tests/peers/inference.py --burn tests/peers/burn/target/release/nst-peer-burn \\
        --lanes 2048 -o docs/inference-lavapipe.csv

On the CPU, `nst` is beside ONNX Runtime and PyTorch. With `--burn`, its kernels on the GPU
are beside the framework Burn on the same one. All take turns, so that what else the
machine does hits all; `gemm`, which `nst` measures beside itself, is a layer of 256 neurons
alone, and `copy` moves as many bytes as sequences and estimates have. All use as many
threads. `nst` is its program bench-inference, from $BENCH_INFERENCE or target/release. Before
anything is timed, every program's answers are compared with the network in f64.
"""

import argparse
import csv
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import astuple, dataclass, fields
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import torch
from onnx import TensorProto, helper, numpy_helper
from safetensors.numpy import save_file

REPOSITORY = Path(__file__).resolve().parents[2]
WINDOW = 8
SLOPE = np.float32(0.01)
SHAPES = [(2, 32), (2, 64), (4, 64), (4, 128), (4, 256)]
TOLERANCE = 1e-5
"""Relative to the sum of the magnitudes that the output layer adds up, as in Rust."""

TURN = 0.02
"""How many seconds a program's turn takes at least."""

Name = tuple[str, str]
"""Backend and adapter."""

Layers = list[tuple[np.ndarray, np.ndarray]]
"""Per layer: weight [out, in], bias [out], in f32."""


@dataclass(frozen=True)
class Row:
    """Medians over rounds; times are from inputs in memory to outputs in memory."""

    backend: str
    adapter: str
    layers: int
    hidden: int
    lanes: int
    milliseconds: float
    gflops: float
    share_of_peak: float
    threads: int


def mix(z: np.ndarray) -> np.ndarray:
    """The output function of SplitMix64."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def inputs(lanes: int) -> np.ndarray:
    """[term][lane]: uniform numbers, the same as in `burn`; their values cost no time."""
    gamma = np.uint64(0x9E3779B97F4A7C15)
    with np.errstate(over="ignore"):
        start = mix(mix(np.array([1], np.uint64) + gamma) ^ np.uint64(lanes))
        steps = np.arange(1, WINDOW * lanes + 1, dtype=np.uint64)
        bits = mix(start + steps * gamma)
    uniform = (bits >> np.uint64(11)).astype(np.float64) / 2.0**53
    return uniform.astype(np.float32).reshape(WINDOW, lanes)


def random_layers(depth: int, hidden: int) -> Layers:
    """Weights of a usual size (He et al. 2015)."""
    random = np.random.default_rng([depth, hidden])
    widths = [WINDOW, *[hidden] * depth, 1]
    return [
        (
            (random.uniform(-1, 1, (b, a)) * np.sqrt(6 / a)).astype(np.float32),
            random.uniform(-1, 1, b).astype(np.float32),
        )
        for a, b in pairwise(widths)
    ]


def flops_per_lane(layers: Layers) -> int:
    return sum(2 * weight.size for weight, _ in layers)


def check(name: str, layers: Layers, terms: np.ndarray, values: np.ndarray) -> None:
    """Compares the first lanes with the network in f64."""
    count = min(256, terms.shape[1])
    x = terms[:, :count].astype(np.float64)
    for weight, bias in layers[:-1]:
        x = weight.astype(np.float64) @ x + bias[:, None].astype(np.float64)
        x = np.where(x > 0, x, float(SLOPE) * x)
    weight, bias = (part.astype(np.float64) for part in layers[-1])
    expected = (weight @ x)[0] + bias[0]
    magnitude = (abs(weight) @ abs(x))[0] + abs(bias[0])
    error = np.max(abs(values.reshape(-1)[:count] - expected) / magnitude)
    assert values.size == terms.shape[1] and error <= TOLERANCE, f"{name}: error {error:e}"


def write_weights(path: Path, layers: Layers) -> None:
    tensors = {}
    for i, (weight, bias) in enumerate(layers):
        tensors |= {f"layers.{i}.weight": weight, f"layers.{i}.bias": bias}
    metadata = {
        "format": "nst-weights-1",
        "kind": "mlp",
        "window": str(WINDOW),
        "inputs": "window",
        "activation": "leaky_relu",
        "negative_slope": str(SLOPE),
        "trained_on": "nothing",
        "samples": "8..64",
        "loss": "L2",
        "epochs": "0",
        "seed": "0",
        "config": "random",
    }
    save_file(tensors, path, metadata)


def nst(path: Path, lanes: int, threads: int, gpu: bool) -> tuple[dict[Name, float], float]:
    """Seconds of `nst` by backend and adapter, and the GFLOP/s of `gemm` beside it."""
    program = os.environ.get("BENCH_INFERENCE", REPOSITORY / "target/release/bench-inference")
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder, "rows.csv")
        command = [program, "--weights", path, "--lanes", lanes]
        command += ["--threads", threads, "--runs", 3, "--quiet", "-o", table]
        command += ["--backend", "gpu", "--variants"] if gpu else ["--backend", "cpu"]
        subprocess.run([str(part) for part in command], check=True)
        with table.open(newline="", encoding="utf-8") as file:
            rows = {(row["backend"], row["adapter"]): row for row in csv.DictReader(file)}
    gemm = float(rows.pop(("gemm", "256x256"))["gflops"])
    return {name: float(row["milliseconds"]) / 1e3 for name, row in rows.items()}, gemm


def burn(program: Path, path: Path, lanes: int) -> tuple[Name, float]:
    """Burn's adapter and the median of its seconds; it checks its answers itself."""
    command = [str(program), str(path), str(lanes), str(TURN)]
    said = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    adapter, milliseconds = said.strip().rsplit(";", 1)
    return ("burn", adapter), float(milliseconds) / 1e3


def copy(lanes: int) -> Callable[[], np.ndarray]:
    """Reads and writes the bytes of `lanes` windows and estimates, half of them each."""
    source = np.ones((WINDOW + 1) * lanes // 2, np.float32)
    target = np.zeros_like(source)

    def run() -> np.ndarray:
        np.copyto(target, source)
        return target

    return run


def onnx_runtime(layers: Layers, terms: np.ndarray, threads: int) -> Callable[[], np.ndarray]:
    nodes, constants, name = [], [], "x0"
    for i, (weight, bias) in enumerate(layers):
        constants += [
            numpy_helper.from_array(np.ascontiguousarray(weight.T), f"w{i}"),
            numpy_helper.from_array(bias, f"b{i}"),
        ]
        nodes.append(helper.make_node("Gemm", [name, f"w{i}", f"b{i}"], [f"y{i}"]))
        name = f"y{i}"
        if i + 1 < len(layers):
            nodes.append(helper.make_node("LeakyRelu", [name], [f"x{i + 1}"], alpha=float(SLOPE)))
            name = f"x{i + 1}"
    graph = helper.make_graph(
        nodes,
        "mlp",
        [helper.make_tensor_value_info("x0", TensorProto.FLOAT, ["lanes", WINDOW])],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, ["lanes", 1])],
        constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(model)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(
        model.SerializeToString(), options, providers=["CPUExecutionProvider"]
    )
    x = np.ascontiguousarray(terms.T)
    return lambda: session.run(None, {"x0": x})[0]


def pytorch(layers: Layers, terms: np.ndarray, threads: int) -> Callable[[], np.ndarray]:
    torch.set_num_threads(threads)
    modules: list[torch.nn.Module] = []
    for weight, bias in layers:
        linear = torch.nn.Linear(weight.shape[1], weight.shape[0])
        linear.weight.data, linear.bias.data = torch.from_numpy(weight), torch.from_numpy(bias)
        modules += [linear, torch.nn.LeakyReLU(float(SLOPE), inplace=True)]
    model = torch.nn.Sequential(*modules[:-1]).eval()
    x = torch.from_numpy(np.ascontiguousarray(terms.T))

    def run() -> np.ndarray:
        with torch.inference_mode():
            return model(x).numpy()

    return run


def turn(call: Callable[[], np.ndarray]) -> list[float]:
    """The seconds of each call, after one that wakes the threads up; as `nst` does it."""
    call()
    times: list[float] = []
    while sum(times) < TURN:
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return times


def measure(
    depth: int, hidden: int, lanes: int, rounds: int, threads: int, burn_program: Path | None
) -> list[Row]:
    layers, terms = random_layers(depth, hidden), inputs(lanes)
    peers: dict[Name, Callable[[], np.ndarray]] = {}
    if burn_program is None:
        peers["onnxruntime", onnxruntime.__version__] = onnx_runtime(layers, terms, threads)
        peers["pytorch", torch.__version__] = pytorch(layers, terms, threads)
    for (name, _), call in peers.items():
        check(name, layers, terms, call())
    peers["copy", "numpy"] = copy(lanes)
    seconds: dict[Name, list[float]] = {}
    gemm = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "network.safetensors")
        write_weights(path, layers)
        for _ in range(rounds):
            times, rate = nst(path, lanes, threads, gpu=burn_program is not None)
            gemm.append(rate)
            if burn_program is not None:
                name, time_of_burn = burn(burn_program, path, lanes)
                times[name] = time_of_burn
            times |= {name: statistics.median(turn(call)) for name, call in peers.items()}
            for name, time_of_one in times.items():
                seconds.setdefault(name, []).append(time_of_one)
    flops = flops_per_lane(layers) * lanes
    peak = statistics.median(gemm)
    # What the network would take at the rate of `gemm`: the floor by arithmetic.
    seconds["gemm", "256x256"] = [flops / peak / 1e9]
    rows = []
    for name, times in seconds.items():
        median = statistics.median(times)
        gflops = 0.0 if name[0] == "copy" else flops / median / 1e9
        rows.append(Row(*name, depth, hidden, lanes, 1e3 * median, gflops, gflops / peak, threads))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare nst with other programs.")
    parser.add_argument("--burn", type=Path, metavar="PROGRAM", help="compare with this, on the GPU")
    parser.add_argument("--lanes", type=int, nargs="+", default=[1024, 16384, 262144])
    parser.add_argument("--rounds", type=int, default=7, help="turns of each (default: 7)")
    parser.add_argument("--threads", type=int, default=2, help="default: 2")
    parser.add_argument("-o", "--output", type=Path, metavar="CSV", help="file to write")
    args = parser.parse_args()
    rows = []
    for depth, hidden in SHAPES:
        for lanes in args.lanes:
            new = measure(depth, hidden, lanes, args.rounds, args.threads, args.burn)
            rows += new
            print(f"{depth}x{hidden}, {lanes} lanes:")
            for row in new:
                ratio = row.milliseconds / new[0].milliseconds
                what = f"{row.milliseconds:9.3f} ms {row.gflops:7.1f} GFLOP/s {ratio:6.2f}"
                print(f"    {what}  {row.backend} {row.adapter}")
            sys.stdout.flush()
    if args.output:
        with args.output.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(field.name for field in fields(Row))
            writer.writerows(map(astuple, rows))


if __name__ == "__main__":
    main()
