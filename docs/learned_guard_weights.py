"""Draws docs/learned-guard.png: weights of the closed form and of the network, and what they make of S.

    P="$(tools/python-env docs/requirements-neighbours.txt)"
    $P docs/learned_guard_weights.py

As docs/neighbours_crops.py; of other scenes, at few samples, where they differ most.
"""

import sys

import numpy as np
from learned_guard import METHODS
from neighbours import CACHE, DOCS, PLAIN, errors, estimated, halves, has_reference
from neighbours import METHODS as KNOWN
from neighbours_crops import COLOURS, DARKER, LIGHT, drawn, sheet, weights
from neighbours_make import samples
from PIL import Image

SPP, RUN = 8, 0
EXPERTS = "lane,filter,oidn"
GUARDS = {"closed": "closed form", "learned": "network"}
# Where the part of each scene begins, x and y.
PARTS = {"caustic": (32, 60), "mitsuba-glass": (60, 60), "mitsuba-sticks": (32, 32)}


def row_of(scene: str) -> list[tuple[Image.Image, str]]:
    """Each part and what is written below."""
    sequence = CACHE / scene / f"{SPP}-{RUN}.exr"
    both = halves(scene)
    reference = (both[0] + both[1]) / 2
    exposure = LIGHT / np.quantile(reference.mean(axis=-1), DARKER)
    plain = np.array(errors(estimated(sequence, PLAIN)[0], both))
    cells = []
    for guard in GUARDS:
        method = f"{guard} {EXPERTS}"
        colors = estimated(sequence, method)[0]
        mse, relmse = errors(colors, both) / plain
        text = f"MSE {mse:.2g}, relMSE {relmse:.2g}"
        cells.append((drawn(colors, exposure, PARTS[scene]), text))
        cells.append((drawn(weights(sequence, METHODS[method]), 1.0, PARTS[scene]), COLOURS))
    spp = sum(samples(CACHE / scene / f"reference-{i}.exr") for i in (0, 1))
    return [*cells, (drawn(reference, exposure, PARTS[scene]), f"{spp} spp")]


def main() -> None:
    if missing := [scene for scene in PARTS if not has_reference("test", scene)]:
        sys.exit(f"error: docs/neighbours.py --make has not finished {', '.join(missing)}")
    KNOWN.update(METHODS)
    titles = [title for name in GUARDS.values() for title in (name, "its weights")] + ["reference"]
    rows = {f"{scene}, {SPP} spp": row_of(scene) for scene in PARTS}
    sheet(titles, rows).save(DOCS / "learned-guard.png", optimize=True)


if __name__ == "__main__":
    main()
