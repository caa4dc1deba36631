"""Bounds and areas of a glTF scene at a moment, as Blender's own importer poses it: posed.py SCENE SECONDS.

Prints one JSON object: bounds [[low], [high]] with Y up, area, and the area of each mesh object by name."""

import json
import sys

import bpy
import numpy as np

scene, seconds = sys.argv[1], float(sys.argv[2])
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_scene.gltf(filepath=scene)
fps = bpy.context.scene.render.fps / bpy.context.scene.render.fps_base
frame = seconds * fps
bpy.context.scene.frame_set(int(frame // 1), subframe=frame % 1)
depsgraph = bpy.context.evaluated_depsgraph_get()
low, high, areas = np.full(3, np.inf), np.full(3, -np.inf), {}
for entry in bpy.context.scene.objects:
    # Shapes of bones that the importer makes are no part of the file.
    if entry.type != "MESH" or entry.name not in bpy.context.view_layer.objects or not entry.visible_get():
        continue
    evaluated = entry.evaluated_get(depsgraph)
    mesh = evaluated.to_mesh()
    world = np.array(evaluated.matrix_world)
    points = np.array([v.co for v in mesh.vertices]) @ world[:3, :3].T + world[:3, 3]
    points = np.stack([points[:, 0], points[:, 2], -points[:, 1]], 1)
    mesh.calc_loop_triangles()
    corners = points[np.array([t.vertices for t in mesh.loop_triangles])]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas[entry.name] = float(np.linalg.norm(cross, axis=1).sum() / 2)
    used = np.unique(np.array([t.vertices for t in mesh.loop_triangles]))
    low, high = np.minimum(low, points[used].min(0)), np.maximum(high, points[used].max(0))
print(json.dumps({"bounds": [low.tolist(), high.tolist()], "area": sum(areas.values()), "areas": areas}))
