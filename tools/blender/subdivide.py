"""Refines a cage (JSON: points, faces, creases [a, b, USD sharpness], levels) with Blender's subdivision modifier, which
evaluates the limit surface by OpenSubdiv, and prints the points."""

import json
import sys

import bpy

# Blender keeps the root of a tenth of the sharpness.
FULL = 10.0


def main(question: str):
    given = json.loads(open(question).read())
    mesh = bpy.data.meshes.new("cage")
    mesh.from_pydata(given["points"], [], given["faces"])
    if given["creases"]:
        crease = mesh.attributes.new("crease_edge", "FLOAT", "EDGE")
        sharp = {frozenset((a, b)): s for a, b, s in given["creases"]}
        for edge in mesh.edges:
            crease.data[edge.index].value = (sharp.get(frozenset(edge.vertices), 0.0) / FULL) ** 0.5
    thing = bpy.data.objects.new("cage", mesh)
    bpy.context.collection.objects.link(thing)
    modifier = thing.modifiers.new("subdivision", "SUBSURF")
    modifier.levels = given["levels"]
    modifier.quality = 10
    modifier.boundary_smooth = "PRESERVE_CORNERS"
    modifier.use_limit_surface = True
    modifier.use_creases = True
    refined = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    print(json.dumps({"points": [list(v.co) for v in refined.data.vertices]}))


main(sys.argv[-1])
