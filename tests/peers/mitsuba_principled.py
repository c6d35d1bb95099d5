"""Evaluates Mitsuba 3's principled BSDF at random parameters and directions.

    python tests/peers/mitsuba_principled.py -o tests/data/reference/principled.csv

Each row: the nine parameters of `Disney`, the base colour, wo and wi (unit, in the
local frame), and f(wo, wi) |cos theta_i|. What Mitsuba calls wi is our wo.

Half of the rows are near mirror reflection. Mitsuba computes in f32: its clearcoat
loses all digits where clearcoat_gloss nears 1, so that it stays below 0.9 here.
"""

import argparse
import csv

import mitsuba as mi
import numpy as np

PARAMETERS = [
    "metallic",
    "roughness",
    "specular",
    "specular_tint",
    "anisotropic",
    "sheen",
    "sheen_tint",
    "clearcoat",
    "clearcoat_gloss",
]
NAMES = {"specular_tint": "spec_tint"}


def random_parameters(rng):
    """Uniform on [0, 1], and 0 or 1 one time in four each."""
    values = {}
    for name in PARAMETERS:
        values[name] = rng.choice([0.0, 1.0, rng.random(), rng.random()])
    values["roughness"] = rng.uniform(0.1, 1.0)
    values["specular"] = rng.uniform(0.05, 1.0)
    values["clearcoat_gloss"] *= 0.9
    return values


def random_directions(rng, near):
    """A pair above the surface; near mirror reflection, if so asked."""

    def direction():
        z, phi = rng.uniform(0.05, 1.0), rng.uniform(0.0, 2.0 * np.pi)
        return np.array([np.cos(phi), np.sin(phi), 0.0]) * np.sqrt(1.0 - z * z) + [0.0, 0.0, z]

    wo, wi = direction(), direction()
    if near:
        wi = wo * [-1.0, -1.0, 1.0] + rng.normal(0.0, 0.02, 3)
        wi[2] = abs(wi[2])
        wi /= np.linalg.norm(wi)
    return wo.astype(np.float32), wi.astype(np.float32)


def evaluate(parameters, color, wo, wi):
    values = {NAMES.get(name, name): float(value) for name, value in parameters.items()}
    bsdf = mi.load_dict({"type": "principled", "base_color": {"type": "rgb", "value": color}, **values})
    interaction = mi.SurfaceInteraction3f()
    interaction.wi = mi.Vector3f([float(x) for x in wo])
    return bsdf.eval(mi.BSDFContext(), interaction, mi.Vector3f([float(x) for x in wi]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("--rows", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    mi.set_variant("scalar_rgb")
    rng = np.random.default_rng(args.seed)
    with open(args.output, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        columns = [
            f"{v}.{c}"
            for v, cs in [("color", "rgb"), ("wo", "xyz"), ("wi", "xyz"), ("value", "rgb")]
            for c in cs
        ]
        writer.writerow(PARAMETERS + columns)
        for row in range(args.rows):
            parameters = {n: float(np.float32(v)) for n, v in random_parameters(rng).items()}
            color = [float(x) for x in rng.uniform(0.02, 1.0, 3).astype(np.float32)]
            wo, wi = random_directions(rng, row % 2 == 1)
            value = evaluate(parameters, color, wo, wi)
            numbers = [*parameters.values(), *color, *wo, *wi, *value]
            writer.writerow([f"{float(x):.9g}" for x in numbers])


if __name__ == "__main__":
    main()
