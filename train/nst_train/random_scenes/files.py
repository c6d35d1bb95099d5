"""The files of a scene: OBJ, MTL, TOML and images, from what a branch adds piece by piece."""

from dataclasses import dataclass, field

import numpy as np

Points = np.ndarray
"""Positions or normals, `[corner, xyz]`."""


@dataclass
class RandomScene:
    """A scene as it grows."""

    name: str
    vertices: list[str] = field(default_factory=list)
    coordinates: list[str] = field(default_factory=list)
    normals: list[str] = field(default_factory=list)
    faces: list[str] = field(default_factory=list)
    materials: list[str] = field(default_factory=list)
    images: dict[str, bytes] = field(default_factory=dict)  # by file name
    settings: str = ""  # the TOML file

    def material(self, lines: str) -> str:
        """Defines a material, and returns its name."""
        name = f"m{len(self.materials)}"
        self.materials.append(f"newmtl {name}\n{lines}\n")
        return name

    def image(self, ending: str, content: bytes) -> str:
        """Adds an image, and returns its file name."""
        name = f"{self.name}-{len(self.images)}.{ending}"
        self.images[name] = content
        return name

    def polygons(
        self,
        material: str,
        polygons: list[Points],
        normals: list[Points] | None = None,
        coordinates: list[np.ndarray] | None = None,
    ) -> None:
        """Adds polygons: smooth ones have a normal at each corner, textured ones have coordinates u, v."""
        self.faces.append(f"usemtl {material}")
        for i, corners in enumerate(polygons):
            kinds = [("v", self.vertices, corners)]
            kinds.append(("vt", self.coordinates, coordinates[i] if coordinates else []))
            kinds.append(("vn", self.normals, normals[i] if normals else []))
            columns = []
            for key, lines, values in kinds:
                first = len(lines) + 1
                lines += [f"{key} {numbers(value)}" for value in values]
                columns.append([str(first + k) for k in range(len(values))] or [""] * len(corners))
            words = ["/".join(column).rstrip("/") for column in zip(*columns, strict=True)]
            self.faces.append("f " + " ".join(words))

    def files(self) -> dict[str, bytes]:
        """Contents by file name."""
        lines = [f"mtllib {self.name}.mtl", *self.vertices, *self.coordinates, *self.normals, *self.faces]
        texts = {
            f"{self.name}.obj": "\n".join(lines) + "\n",
            f"{self.name}.mtl": "\n".join(self.materials),
            f"{self.name}.toml": self.settings,
        }
        return {name: text.encode("ascii") for name, text in texts.items()} | self.images


def numbers(values: np.ndarray | list[float], between: str = " ") -> str:
    """Six decimals each, the same on every machine."""
    return between.join(f"{float(x) + 0.0:.6f}" for x in values)
