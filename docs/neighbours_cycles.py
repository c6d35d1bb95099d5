"""Cycles' scene for docs/neighbours.py, by an interpreter that has Blender's module `bpy`:

    python docs/neighbours_cycles.py FOLDER SPP SEED COUNT

writes COUNT files `seed-000000.exr` and so on, whose seeds count up from SEED. Cycles sends the first sample
of each pixel through its middle, whatever the seed; so all samples go there, as nearly as Cycles permits.
"""

import math
import random
import sys
from pathlib import Path

import bpy

SIZE = 128, 128
# The least that Cycles takes, in pixels.
FILTER_WIDTH = 0.01


def material(name: str, **inputs: object) -> bpy.types.Material:
    made = bpy.data.materials.new(name)
    if made.node_tree is None:  # before Blender 5.0
        made.use_nodes = True
    for key, value in inputs.items():
        made.node_tree.nodes["Principled BSDF"].inputs[key.replace("_", " ")].default_value = value
    return made


def noise(made: bpy.types.Material, scale: float) -> bpy.types.Material:
    """With a texture as its colour."""
    tree = made.node_tree
    texture = tree.nodes.new("ShaderNodeTexNoise")
    texture.inputs["Scale"].default_value = scale
    tree.links.new(texture.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    return made


def given(made: bpy.types.Material) -> None:
    bpy.context.object.data.materials.append(made)


def build() -> bpy.types.Scene:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    random.seed(21)
    bpy.ops.mesh.primitive_plane_add(size=20)
    given(noise(material("floor", Roughness=0.4), 6.0))
    bpy.ops.mesh.primitive_plane_add(size=20, location=(0, 5, 0), rotation=(math.pi / 2, 0, 0))
    given(material("wall", Base_Color=(0.6, 0.55, 0.5, 1)))
    for i in range(14):
        place = random.uniform(-3, 3), random.uniform(-2, 3.5)
        size = random.uniform(0.25, 0.6)
        color = *(random.uniform(0.1, 0.9) for _ in range(3)), 1
        if i % 3 == 0:
            bpy.ops.mesh.primitive_uv_sphere_add(
                radius=size, segments=48, ring_count=24, location=(*place, size)
            )
            bpy.ops.object.shade_smooth()
            given(material(f"ball{i}", Base_Color=color, Metallic=1.0, Roughness=0.15))
        elif i % 3 == 1:
            bpy.ops.mesh.primitive_cube_add(size=2 * size, location=(*place, size), rotation=(0, 0, i))
            given(material(f"block{i}", Base_Color=color, Roughness=0.3))
        else:
            bpy.ops.mesh.primitive_cone_add(radius1=size, depth=2 * size, location=(*place, size))
            given(noise(material(f"cone{i}", Roughness=0.7), 12.0))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.2, location=(1.6, 1.5, 2.2))
    given(material("bulb", Emission_Color=(1, 0.8, 0.5, 1), Emission_Strength=60.0))
    bpy.ops.object.light_add(type="AREA", location=(-3, -3, 5), rotation=(0.6, -0.5, 0))
    bpy.context.object.data.size, bpy.context.object.data.energy = 1, 400
    bpy.ops.object.camera_add(location=(0, -9, 3.4), rotation=(1.28, 0, 0))
    scene = bpy.context.scene
    scene.camera = bpy.context.object
    return scene


def settings(scene: bpy.types.Scene, spp: int) -> None:
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.use_persistent_data = True
    scene.cycles.samples = spp
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.sampling_pattern = "TABULATED_SOBOL"
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.filter_width = FILTER_WIDTH
    # Clamped light would not be that of the reference.
    scene.cycles.sample_clamp_indirect = 0.0
    output = scene.render.image_settings
    if bpy.app.version >= (5, 0, 0):
        output.media_type = "MULTI_LAYER_IMAGE"
    else:
        output.file_format = "OPEN_EXR_MULTILAYER"
    output.color_depth = "32"
    layer = scene.view_layers[0]
    layer.use_pass_z = layer.cycles.denoising_store_passes = True
    layer.use_pass_emit = layer.use_pass_environment = True


def main(folder: Path, spp: int, seed: int, count: int) -> None:
    scene = build()
    settings(scene, spp)
    for i in range(count):
        scene.cycles.seed = seed + i
        scene.render.filepath = str(folder / f"seed-{i:06}.exr")
        bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
