"""The same networks on the same inputs by `nst`, ONNX Runtime and PyTorch, on the CPU.

    python tests/peers/inference.py -o docs/inference.csv

The three take turns, so that what else the machine does hits all; `gemm`, which `nst`
measures beside itself, is a layer of 256 neurons alone. All use as many threads. `nst`
comes from $NST, or from target/release. Before anything is timed, every program's
answers are compared with the network in f64.
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
    """[term][lane]: what `nst bench inference` makes for so many lanes."""
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
        for a, b in zip(widths, widths[1:])
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


def nst(path: Path, lanes: int, threads: int) -> tuple[float, float, str]:
    """Seconds of `nst`, GFLOP/s of `gemm` beside it, and the instructions used."""
    program = os.environ.get("NST", REPOSITORY / "target/release/nst")
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder, "rows.csv")
        command = [program, "bench", "inference", "--weights", path, "--lanes", lanes]
        command += ["--backend", "cpu", "--threads", threads, "--runs", 5, "--quiet", "-o", table]
        subprocess.run([str(part) for part in command], check=True)
        with table.open(newline="", encoding="utf-8") as file:
            rows = {row["backend"]: row for row in csv.DictReader(file)}
    cpu = rows["cpu"]
    return float(cpu["milliseconds"]) / 1e3, float(rows["gemm"]["gflops"]), cpu["adapter"]


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
            nodes.append(
                helper.make_node("LeakyRelu", [name], [f"x{i + 1}"], alpha=float(SLOPE))
            )
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


def median_of(call: Callable[[], np.ndarray], runs: int) -> float:
    """The median time of some runs, as `nst` takes it."""
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def measure(depth: int, hidden: int, lanes: int, rounds: int, threads: int) -> list[Row]:
    layers, terms = random_layers(depth, hidden), inputs(lanes)
    peers = {
        f"onnxruntime {onnxruntime.__version__}": onnx_runtime(layers, terms, threads),
        f"pytorch {torch.__version__}": pytorch(layers, terms, threads),
    }
    for name, call in peers.items():
        check(name, layers, terms, call())
    seconds: dict[str, list[float]] = {name: [] for name in ["cpu", *peers]}
    gemm = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "network.safetensors")
        write_weights(path, layers)
        for _ in range(rounds):
            ours, peak, instructions = nst(path, lanes, threads)
            seconds["cpu"].append(ours)
            gemm.append(peak)
            for name, call in peers.items():
                call()  # wakes its threads up
                seconds[name].append(median_of(call, 5))
    peak = statistics.median(gemm)
    rows = []
    for name, times in seconds.items():
        median = statistics.median(times)
        gflops = flops_per_lane(layers) * lanes / median / 1e9
        backend, _, version = name.partition(" ")
        rows.append(
            Row(
                backend=backend,
                adapter=version or instructions,
                layers=depth,
                hidden=hidden,
                lanes=lanes,
                milliseconds=1e3 * median,
                gflops=gflops,
                share_of_peak=gflops / peak,
                threads=threads,
            )
        )
    gemm_ms = 2 * 256 * 256 * lanes / peak / 1e6
    rows.append(Row("gemm", "256x256", 1, 256, lanes, gemm_ms, peak, 1.0, threads))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare nst, ONNX Runtime and PyTorch.")
    parser.add_argument("--lanes", type=int, nargs="+", default=[1024, 16384, 262144])
    parser.add_argument("--rounds", type=int, default=7, help="turns of each (default: 7)")
    parser.add_argument("--threads", type=int, default=2, help="default: 2")
    parser.add_argument("-o", "--output", type=Path, metavar="CSV", help="file to write")
    args = parser.parse_args()
    rows = []
    for depth, hidden in SHAPES:
        for lanes in args.lanes:
            new = measure(depth, hidden, lanes, args.rounds, args.threads)
            rows += new
            ours = new[0].milliseconds
            what = ", ".join(
                f"{row.backend} {row.milliseconds:.2f} ms ({row.milliseconds / ours:.2f})"
                for row in new[1:-1]
            )
            share = f"{new[0].share_of_peak:.2f} of gemm's {new[-1].gflops:.0f} GFLOP/s"
            print(f"{depth}x{hidden}, {lanes} lanes: nst {ours:.2f} ms, {share}; {what}")
            sys.stdout.flush()
    if args.output:
        with args.output.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(field.name for field in fields(Row))
            writer.writerows(map(astuple, rows))


if __name__ == "__main__":
    main()
