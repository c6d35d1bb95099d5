"""EXR files as Blender's renderer Cycles writes them, for `nst pack` to read.

    python3.11 -m venv FOLDER
    FOLDER/bin/pip install -r tests/peers/requirements-cycles.txt
    FOLDER/bin/python tests/peers/cycles_files.py fixtures   # those of tests/data/cycles
    FOLDER/bin/python tests/peers/cycles_files.py seeds OUT  # sixteen seeds and a reference
    FOLDER/bin/python tests/peers/cycles_files.py kinds OUT  # two files of each kind of output

`./test` does not run this: Blender as a Python module (`bpy`) is a download of 380 MB, and needs
Python 3.11. The tests read what it wrote once. It also works with `bpy` 4.2.0.

The scene is our own: a cube and a sphere on a plane, below an area light. Settings that are not
named here are Blender's defaults, which also choose the files' layout and attributes.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import bpy

FIXTURES = Path(__file__).resolve().parents[1] / "data" / "cycles"
SEEDS, SPP, REFERENCE_SPP = 16, 16, 4096
SIZE, FIXTURE_SIZE = (24, 16), (12, 8)


def material(name: str, color: tuple[float, float, float]) -> bpy.types.Material:
    made = bpy.data.materials.new(name)
    if made.node_tree is None:  # before Blender 5.0
        made.use_nodes = True
    made.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*color, 1.0)
    return made


def build(size: tuple[int, int]) -> bpy.types.Scene:
    """Replaces what is loaded by the scene, with the defaults for everything but its contents."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_plane_add(size=12)
    bpy.context.object.data.materials.append(material("floor", (0.7, 0.7, 0.7)))
    bpy.ops.mesh.primitive_cube_add(size=2, location=(-1.2, 0, 1), rotation=(0, 0, 0.4))
    bpy.context.object.data.materials.append(material("cube", (0.8, 0.2, 0.1)))
    bpy.ops.mesh.primitive_uv_sphere_add(location=(1.2, 0.3, 1))
    bpy.context.object.data.materials.append(material("ball", (0.1, 0.3, 0.8)))
    bpy.ops.object.light_add(type="AREA", location=(2, -3, 5), rotation=(0.6, 0.3, 0))
    bpy.context.object.data.size, bpy.context.object.data.energy = 2, 500
    bpy.ops.object.camera_add(location=(0, -8, 3.2), rotation=(1.3, 0, 0))
    scene = bpy.context.scene
    scene.camera = bpy.context.object
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = size
    sampled(scene, SPP)
    return scene


def sampled(scene: bpy.types.Scene, spp: int) -> None:
    """The same number of samples for every pixel, and nothing that changes them afterwards."""
    scene.cycles.samples = spp
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False


def multilayer(scene: bpy.types.Scene, depth: str = "32") -> None:
    """`OpenEXR MultiLayer`: every pass of every view layer in one file."""
    settings = scene.render.image_settings
    if bpy.app.version >= (5, 0, 0):
        settings.media_type = "MULTI_LAYER_IMAGE"
    else:
        settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth = depth


def plain(scene: bpy.types.Scene, depth: str = "32") -> None:
    """`OpenEXR`: the picture alone."""
    settings = scene.render.image_settings
    if bpy.app.version >= (5, 0, 0):
        settings.media_type = "IMAGE"
    settings.file_format = "OPEN_EXR"
    settings.color_depth = depth


def passes(scene: bpy.types.Scene) -> None:
    """Those that people give a denoiser, and `Depth`."""
    layer = scene.view_layers[0]
    layer.use_pass_z = layer.use_pass_normal = layer.cycles.denoising_store_passes = True


def write(scene: bpy.types.Scene, path: Path, seed: int) -> None:
    scene.cycles.seed = seed
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def half_float(scene: bpy.types.Scene) -> None:
    multilayer(scene, "16")


def half_float_alone(scene: bpy.types.Scene) -> None:
    plain(scene, "16")


def transparent(scene: bpy.types.Scene) -> None:
    plain(scene)
    scene.render.film_transparent = True


def without_alpha(scene: bpy.types.Scene) -> None:
    plain(scene)
    scene.render.image_settings.color_mode = "RGB"


def gray(scene: bpy.types.Scene) -> None:
    plain(scene)
    scene.render.image_settings.color_mode = "BW"


def view_layers(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    scene.view_layers.new("Second Layer")


def view_layers_alone(scene: bpy.types.Scene) -> None:
    plain(scene)
    scene.view_layers.new("Second Layer")


def layer_samples(scene: bpy.types.Scene) -> None:
    """A view layer with its own number of samples, beside one with the scene's."""
    view_layers(scene)
    scene.view_layers[0].samples = 2 * SPP


def denoised(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    passes(scene)
    scene.cycles.use_denoising = True


def adaptive(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    scene.cycles.use_adaptive_sampling = True
    scene.view_layers[0].cycles.pass_debug_sample_count = True


def border(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    scene.render.use_border = True
    scene.render.border_min_x, scene.render.border_max_x = 0.25, 0.75
    scene.render.border_min_y, scene.render.border_max_y = 0.25, 0.75


def crop(scene: bpy.types.Scene) -> None:
    border(scene)
    scene.render.use_crop_to_border = True


def border_alone(scene: bpy.types.Scene) -> None:
    border(scene)
    plain(scene)


def crop_alone(scene: bpy.types.Scene) -> None:
    crop(scene)
    plain(scene)


def both_eyes(scene: bpy.types.Scene) -> None:
    """In one file."""
    scene.render.use_multiview = True
    scene.render.image_settings.views_format = "MULTIVIEW"


def stereo(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    both_eyes(scene)


def stereo_interleaved(scene: bpy.types.Scene) -> None:
    stereo(scene)
    interleave(scene)


def stereo_alone(scene: bpy.types.Scene) -> None:
    plain(scene)
    both_eyes(scene)


def stereo_files(scene: bpy.types.Scene) -> None:
    """A file for each eye, which is the default: `…_L.exr` and `…_R.exr`."""
    multilayer(scene)
    scene.render.use_multiview = True


def cryptomatte(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    layer = scene.view_layers[0]
    layer.use_pass_cryptomatte_object = layer.use_pass_cryptomatte_material = True
    layer.use_pass_cryptomatte_asset = True


def every_pass(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    layer = scene.view_layers[0]
    for owner in (layer, layer.cycles):
        for setting in owner.bl_rna.properties:
            if setting.identifier.startswith(("use_pass_", "denoising_store_", "pass_")):
                setattr(owner, setting.identifier, True)


def light_groups(scene: bpy.types.Scene) -> None:
    """The light of each group by itself, beside that of all."""
    multilayer(scene)
    scene.view_layers[0].lightgroups.add(name="key")
    bpy.data.objects["Area"].lightgroup = "key"


def composited(scene: bpy.types.Scene) -> None:
    """With a compositor that inverts the picture: its result is a layer of its own."""
    multilayer(scene)
    if bpy.app.version >= (5, 0, 0):
        tree = bpy.data.node_groups.new("compositor", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        output = tree.nodes.new("NodeGroupOutput")
        scene.compositing_node_group = tree
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        output = tree.nodes.new("CompositorNodeComposite")
    layers = tree.nodes.new("CompositorNodeRLayers")
    inverted = tree.nodes.new("CompositorNodeInvert")
    tree.links.new(layers.outputs["Image"], inverted.inputs["Color"])
    tree.links.new(inverted.outputs["Color"], output.inputs["Image"])


def composited_alone(scene: bpy.types.Scene) -> None:
    composited(scene)
    plain(scene)


def interleave(scene: bpy.types.Scene) -> None:
    """One part for all passes, as always before Blender 5.0."""
    if bpy.app.version >= (5, 0, 0):
        scene.render.image_settings.use_exr_interleave = True


def interleaved(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    passes(scene)
    interleave(scene)


def named_layer(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    passes(scene)
    scene.view_layers[0].name = "Key light v1.2 (ü)"


def subset(scene: bpy.types.Scene) -> None:
    """Some of the scene's samples, as farms distribute them."""
    multilayer(scene)
    scene.cycles.samples = 4 * SPP
    scene.cycles.use_sample_subset = True
    scene.cycles.sample_offset, scene.cycles.sample_subset_length = SPP, SPP


def time_limit(scene: bpy.types.Scene) -> None:
    multilayer(scene)
    scene.cycles.samples, scene.cycles.time_limit = 1 << 20, 0.5


def acescg(scene: bpy.types.Scene, space: str = "ACEScg") -> None:
    """Another colour space for files than the working space."""
    multilayer(scene)
    scene.render.image_settings.color_management = "OVERRIDE"
    scene.render.image_settings.linear_colorspace_settings.name = space


def srgb(scene: bpy.types.Scene) -> None:
    acescg(scene, "sRGB")


def lossy(scene: bpy.types.Scene) -> None:
    multilayer(scene, "16")
    scene.render.image_settings.exr_codec = "DWAA"


KINDS: dict[str, Callable[[bpy.types.Scene], None]] = {
    "multilayer": multilayer,
    "half-float": half_float,
    "lossy": lossy,
    "plain": plain,
    "half-float-alone": half_float_alone,
    "transparent": transparent,
    "without-alpha": without_alpha,
    "gray": gray,
    "view-layers": view_layers,
    "view-layers-alone": view_layers_alone,
    "layer-samples": layer_samples,
    "denoised": denoised,
    "adaptive": adaptive,
    "border": border,
    "border-alone": border_alone,
    "crop": crop,
    "crop-alone": crop_alone,
    "stereo": stereo,
    "stereo-interleaved": stereo_interleaved,
    "stereo-alone": stereo_alone,
    "stereo-files": stereo_files,
    "cryptomatte": cryptomatte,
    "every-pass": every_pass,
    "light-groups": light_groups,
    "composited": composited,
    "composited-alone": composited_alone,
    "interleaved": interleaved,
    "named-layer": named_layer,
    "subset": subset,
    "time-limit": time_limit,
    "acescg": acescg,
    "srgb": srgb,
}
# Those that are committed, of one seed each.
FIXTURE_KINDS = [
    "plain",
    "half-float-alone",
    "gray",
    "interleaved",
    "layer-samples",
    "denoised",
    "composited",
    "stereo",
    "named-layer",
    "acescg",
]


def write_seeds(out: Path, size: tuple[int, int], set_passes: Callable[[bpy.types.Scene], None]) -> None:
    """Renderings with different seeds, `seed-00.exr` and so on, and one of many samples."""
    scene = build(size)
    multilayer(scene)
    set_passes(scene)
    for seed in range(SEEDS):
        write(scene, out / f"seed-{seed:02}.exr", seed)
    sampled(scene, REFERENCE_SPP)
    write(scene, out / "reference.exr", SEEDS)


def write_kinds(out: Path, size: tuple[int, int], kinds: list[str], seeds: range) -> None:
    for kind in kinds:
        scene = build(size)
        KINDS[kind](scene)
        for seed in seeds:
            write(scene, out / f"{kind}-{seed}.exr", seed)


def depth(scene: bpy.types.Scene) -> None:
    scene.view_layers[0].use_pass_z = True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("what", choices=["fixtures", "seeds", "kinds"])
    parser.add_argument("out", type=Path, nargs="?", default=FIXTURES, metavar="OUT")
    args = parser.parse_args()
    if args.what == "fixtures":
        write_seeds(args.out, FIXTURE_SIZE, depth)
        write_kinds(args.out, FIXTURE_SIZE, FIXTURE_KINDS, range(1))
    elif args.what == "seeds":
        write_seeds(args.out, SIZE, passes)
    else:
        write_kinds(args.out, SIZE, list(KINDS), range(2))


if __name__ == "__main__":
    main()
