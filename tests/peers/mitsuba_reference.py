"""Renders a scene of this project with Mitsuba 3: a reference that shares no code with ours.

    python tests/peers/mitsuba_reference.py scenes/cornell/cornell.obj \\
        --size 64x64 -o tests/data/reference/cornell-64.exr

K independent renders (K seeds) give, per pixel and channel, their mean (R, G, B)
and the estimated variance of that mean (Variance.R, Variance.G, Variance.B):

    mean = (1/K) sum_k x_k        variance = sum_k (x_k - mean)^2 / (K (K - 1))

Only diffuse materials (Kd) and area lights (Ke) are translated. Anything else in
the scene's files is an error, so that a reference never leaves something out.
"""

import argparse
import os
import sys
import tempfile
import tomllib
from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR


class SceneError(Exception):
    """What the scene's files hold and this script does not translate."""


def statements(path):
    """Yields (line number, keyword, arguments) for each line of an OBJ or MTL file."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            yield number, words[0], words[1:]


def read_obj(path):
    """Returns the vertices [n, 3], triangles by material {name: [m, 3]} and MTL paths."""
    vertices, triangles, libraries = [], {}, []
    material = None
    for number, keyword, args in statements(path):
        if keyword == "v":
            vertices.append([float(x) for x in args[:3]])
        elif keyword == "f":
            if material is None:
                raise SceneError(f"{path}:{number}: a face before the first usemtl")
            # A polygon a b c d … is the fan abc, acd, …; indices start at 1, or at the end.
            corners = [int(x) - 1 if int(x) > 0 else len(vertices) + int(x) for x in args]
            fan = [[corners[0], b, c] for b, c in zip(corners[1:], corners[2:])]
            triangles.setdefault(material, []).extend(fan)
        elif keyword == "usemtl":
            material = args[0]
        elif keyword == "mtllib":
            libraries.append(path.with_name(args[0]))
        elif keyword not in ("o", "g"):
            raise SceneError(f"{path}:{number}: '{keyword}' is not translated")
    triangles = {name: np.array(faces) for name, faces in triangles.items()}
    return np.array(vertices), triangles, libraries


def read_mtl(path):
    """Returns {material: {"Kd": rgb, "Ke": rgb}}; black where the file gives none."""
    materials = {}
    for number, keyword, args in statements(path):
        if keyword == "newmtl":
            material = materials.setdefault(args[0], {"Kd": [0.0] * 3, "Ke": [0.0] * 3})
        elif keyword in ("Kd", "Ke"):
            material[keyword] = [float(x) for x in args]
        else:
            raise SceneError(f"{path}:{number}: '{keyword}' is not translated")
    return materials


def read_sidecar(path):
    """Returns the camera and integrator tables and the film size of the TOML sidecar."""
    with path.open("rb") as file:
        sidecar = tomllib.load(file)
    unknown = sidecar.keys() - {"camera", "film", "integrator"}
    if unknown:
        raise SceneError(f"{path}: [{min(unknown)}] is not translated")
    return sidecar["camera"], sidecar["integrator"], sidecar["film"]["size"]


def face_the_scene(faces, vertices, eye):
    """Turns an emitter's triangles so that their front side sees the scene.

    Our lights emit on both sides, Mitsuba's on the side of the geometric normal.
    Both give the same image where nothing is behind the light, as for the one that
    fills the hole in the Cornell box's ceiling. Every vertex and the eye must
    therefore be on one side of each triangle's plane; that side becomes the front.
    """
    points = np.vstack([vertices, eye])
    tolerance = 1e-6 * np.ptp(points, axis=0).max()
    turned = []
    for a, b, c in faces:
        normal = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
        height = (points - vertices[a]) @ (normal / np.linalg.norm(normal))
        if height.min() >= -tolerance:
            turned.append([a, b, c])
        elif height.max() <= tolerance:
            turned.append([a, c, b])
        else:
            raise SceneError("an emitter has scene on both sides: Mitsuba's emit on one side only")
    return np.array(turned)


def rgb(value):
    return {"type": "rgb", "value": value}


def mesh(name, vertices, faces, material, eye):
    """One Mitsuba mesh: flat triangles, diffuse on both sides, an area light if Ke is not black."""
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(
        {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": rgb(material["Kd"])}}
    )
    if any(material["Ke"]):
        faces = face_the_scene(faces, vertices, eye)
        properties["emitter"] = mi.load_dict({"type": "area", "radiance": rgb(material["Ke"])})
    result = mi.Mesh(name, len(vertices), len(faces), props=properties)
    parameters = mi.traverse(result)
    parameters["vertex_positions"] = np.ravel(vertices)
    parameters["faces"] = np.ravel(faces)
    parameters.update()
    return result


def load_scene(path, size):
    """Returns the Mitsuba scene for an OBJ file with its MTL files and TOML sidecar."""
    vertices, triangles, libraries = read_obj(path)
    materials = {}
    for library in libraries:
        materials |= read_mtl(library)
    camera, integrator, film_size = read_sidecar(path.with_suffix(".toml"))
    width, height = size or film_size

    scene = {
        "type": "scene",
        # max_depth counts as ours does: 1 is directly seen emission, 2 adds direct light.
        "integrator": {
            "type": "path",
            "max_depth": 2 if integrator["kind"] == "direct" else integrator["max_depth"],
            "hide_emitters": False,
        },
        "sensor": {
            "type": "perspective",
            "fov": camera["vertical_fov"],
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(
                origin=camera["position"], target=camera["target"], up=camera["up"]
            ),
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
    }
    for name, faces in triangles.items():
        scene[f"mesh_{name}"] = mesh(name, vertices, faces, materials[name], camera["position"])
    return mi.load_dict(scene)


def mean_and_variance(scene, seeds, spp):
    """Renders once per seed; returns the mean image and the variance of that mean."""
    total, total_of_squares = 0.0, 0.0
    for done, seed in enumerate(seeds, start=1):
        image = np.array(mi.render(scene, spp=spp, seed=seed), dtype=np.float64)
        total = total + image
        total_of_squares = total_of_squares + image**2
        if done % 16 == 0:
            print(f"{done} of {len(seeds)} renders", file=sys.stderr)
    runs = len(seeds)
    mean = total / runs
    return mean, np.maximum(total_of_squares / runs - mean**2, 0.0) / (runs - 1)


def write_exr(path, mean, variance, attributes):
    """Writes beside the output and renames, so that a broken run leaves the old file."""
    channels = {}
    for i, name in enumerate("RGB"):
        channels[name] = np.ascontiguousarray(mean[..., i], dtype=np.float32)
        channels[f"Variance.{name}"] = np.ascontiguousarray(variance[..., i], dtype=np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        unfinished = os.path.join(folder, path.name)
        OpenEXR.File(header, channels).write(unfinished)
        os.replace(unfinished, path)


def film_size(text):
    width, height = text.split("x")
    return int(width), int(height)


def arguments():
    parser = argparse.ArgumentParser(description="Render a scene with Mitsuba 3 as a reference.")
    parser.add_argument("scene", type=Path, help="OBJ file, with its MTL and TOML beside it")
    parser.add_argument("-o", "--output", type=Path, required=True, help="EXR file to write")
    parser.add_argument("--size", type=film_size, metavar="WxH", help="default: the sidecar's")
    parser.add_argument("--renders", type=int, default=64, help="independent renders, 2 or more")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel of each render")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first render")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="scalar_rgb needs no LLVM")
    args = parser.parse_args()
    if args.renders < 2:
        parser.error("--renders: a variance needs at least 2")
    if not args.output.parent.is_dir():
        parser.error(f"--output: there is no folder {args.output.parent}")
    return args


def main():
    args = arguments()
    mi.set_variant(args.variant)
    try:
        scene = load_scene(args.scene, args.size)
    except (OSError, SceneError) as error:
        sys.exit(f"mitsuba_reference: {error}")
    seeds = range(args.seed, args.seed + args.renders)
    mean, variance = mean_and_variance(scene, seeds, args.spp)
    attributes = {
        "mitsuba.version": mi.__version__,
        "mitsuba.variant": args.variant,
        "mitsuba.seeds": f"{seeds[0]} to {seeds[-1]}",
        "mitsuba.scene": args.scene.as_posix(),
        "samplesPerPixel": args.renders * args.spp,
    }
    write_exr(args.output, mean, variance, attributes)

    error = np.sqrt(variance).mean(axis=(0, 1)) / mean.mean(axis=(0, 1))
    print(f"{args.output}: mean RGB {mean.mean(axis=(0, 1))}, relative standard error {error}")


if __name__ == "__main__":
    main()
