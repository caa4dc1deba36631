"""render_original.py SCENE OUT.exr WIDTH HEIGHT SAMPLES: path traces a scene, every material diffuse and black behind."""

import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import bpy
import path_tracer


def make_diffuse(material) -> None:
    """The same colour and emission on the front, black on the back."""
    factor, image, emission = path_tracer.base_colour(material)
    tree, output = path_tracer.fresh(material)
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(path_tracer.colour_node(tree, factor, image), diffuse.inputs["Color"])
    glow = tree.nodes.new("ShaderNodeEmission")
    glow.inputs["Color"].default_value = (*emission, 1)
    front = tree.nodes.new("ShaderNodeAddShader")
    tree.links.new(diffuse.outputs[0], front.inputs[0])
    tree.links.new(glow.outputs[0], front.inputs[1])
    back = tree.nodes.new("ShaderNodeBsdfDiffuse")
    back.inputs["Color"].default_value = (0, 0, 0, 1)
    side = tree.nodes.new("ShaderNodeNewGeometry")
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(side.outputs["Backfacing"], mix.inputs[0])
    tree.links.new(front.outputs[0], mix.inputs[1])
    tree.links.new(back.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    if max(emission) > 0:
        material.cycles.emission_sampling = "FRONT"


def main() -> None:
    scene, out = Path(sys.argv[1]), Path(sys.argv[2])
    width, height, samples = (int(v) for v in sys.argv[3:6])
    path_tracer.open_scene(scene)
    for material in bpy.data.materials:
        make_diffuse(material)
    path_tracer.render(width, height, samples, out)
    print(json.dumps({"out": str(out)}))


main()
