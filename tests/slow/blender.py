"""Runs in Blender's Python: ``python blender.py CASES.json RESULTS.json``. Opens each file as a user would, measures.

A case is what `tests.slow.cases.Case` says, lengths in metres, z up; a result has the largest distance (m) by which
something is off where it is expected, or what was raised.
"""

from __future__ import annotations

import json
import sys
import traceback
from pathlib import Path
from typing import Any

import bpy  # type: ignore[import-not-found]
import numpy as np
from mathutils import Vector  # type: ignore[import-not-found]
from mathutils.kdtree import KDTree  # type: ignore[import-not-found]

SAMPLES = 8  # rays a pixel: few, as a look at a shape needs no more


def main(cases: Path, results: Path) -> None:
    found = []
    for case in json.loads(cases.read_text()):
        try:
            found.append(measured(case))
        except Exception:
            found.append({"error": traceback.format_exc()})
    results.write_text(json.dumps(found))


def measured(case: dict[str, Any]) -> dict[str, Any]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = round(case["fps"])
    opened(Path(case["file"]))
    (armature,) = (thing for thing in bpy.data.objects if thing.type == "ARMATURE")
    if on := [thing.name for thing in armature.children if not skinned(thing)]:
        return {"error": f"things of the room hang on the person: {on}"}
    bones, asked = {bone.name for bone in armature.data.bones}, set(case["plays"][0]["moments"][0]["joints"])
    if missing := (set(case["rest"]) or bones | asked) ^ bones:
        return {"error": f"bones here or there only: {sorted(missing)}"}
    found: dict[str, Any] = {"rest": rest(armature, case["rest"])} if case["rest"] else {}
    off: dict[str, list[float]] = {"joints": [], "mesh": [], "things": []}
    for play in case["plays"]:
        only(play["name"])
        for moment in play["moments"]:
            stand(case["first"] + moment["time"] * case["fps"])
            off["joints"].append(heads(armature, moment["joints"]))
            if moment["mesh"]:
                off["mesh"].append(apart(drawn(skinned), np.array(moment["mesh"])))
            for name, corners in moment["things"].items():
                off["things"].append(apart(drawn(lambda thing, name=name: thing.data.name == name), np.array(corners)))
    found |= {what: max(values) for what, values in off.items() if values}
    if case["picture"]:
        only(case["plays"][0]["name"])
        picture(armature, case)
    return found


def opened(path: Path) -> None:
    if path.suffix == ".bvh":
        bpy.ops.import_anim.bvh(filepath=str(path), global_scale=0.01, rotate_mode="QUATERNION")
    elif path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path))
    else:
        bpy.ops.wm.usd_import(filepath=str(path))


def only(name: str) -> None:
    """Play one of the animations, where a file holds several: the importer makes a track of each."""
    for thing in bpy.data.objects:
        if thing.animation_data and len(thing.animation_data.nla_tracks):
            for track in thing.animation_data.nla_tracks:
                track.mute = True  # their strips begin at frame 1, and actions at 0
                if track.name == name:
                    thing.animation_data.action = track.strips[0].action
                    thing.animation_data.action_slot = track.strips[0].action_slot


def stand(frame: float) -> None:
    whole = int(np.floor(frame + 1e-6))
    bpy.context.scene.frame_set(whole, subframe=min(max(frame - whole, 0.0), 0.999999))


def rest(armature: Any, expected: dict[str, list[float]]) -> float:
    """How far joints of the rest pose are off, seen from the root."""
    bones, frame = armature.data.bones, armature.matrix_world
    (root,) = (bone.name for bone in bones if bone.parent is None)
    origin = Vector(expected[root])
    away = [
        (frame @ bones[name].head_local - frame @ bones[root].head_local) - (Vector(place) - origin)
        for name, place in expected.items()
    ]
    return max(one.length for one in away)


def heads(armature: Any, expected: dict[str, list[float]]) -> float:
    frame, bones = armature.matrix_world, armature.pose.bones
    return max((frame @ bones[name].head - Vector(place)).length for name, place in expected.items())


def skinned(thing: Any) -> bool:
    return any(modifier.type == "ARMATURE" for modifier in thing.modifiers)


def drawn(chosen: Any) -> np.ndarray:
    """World vertices of some of the meshes as they are deformed now, those that a face has."""
    graph, found = bpy.context.evaluated_depsgraph_get(), [np.zeros((0, 3))]
    for thing in bpy.data.objects:
        if thing.type == "MESH" and len(thing.data.polygons) and chosen(thing):
            shown = thing.evaluated_get(graph)
            mesh = shown.to_mesh()
            corners = np.array([shown.matrix_world @ vertex.co for vertex in mesh.vertices])
            found.append(corners[sorted({vertex for face in mesh.polygons for vertex in face.vertices})])
            shown.to_mesh_clear()
    return np.concatenate(found)


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """The largest distance from a point of one set to the other set."""
    if not len(a):
        return float("inf")
    return max(_apart(a, b), _apart(b, a))


def _apart(points: np.ndarray, others: np.ndarray) -> float:
    tree = KDTree(len(others))
    for place, point in enumerate(others):
        tree.insert(point, place)
    tree.balance()
    return max(tree.find(point)[2] for point in points)


def picture(armature: Any, case: dict[str, Any]) -> None:
    moments = case["plays"][0]["moments"]
    moment = moments[len(moments) * 2 // 3]
    stand(case["first"] + moment["time"] * case["fps"])
    seen = bpy.context.view_layer.objects  # the importer hides the ball that it draws bones as
    meshes = [thing for thing in seen if thing.type == "MESH" and len(thing.data.polygons) and thing.visible_get()]
    if not meshes:
        sticks(armature)
    scene = bpy.context.scene
    centre = Vector(np.mean(list(moment["joints"].values()), axis=0))
    look(centre, centre + Vector((2.2, -2.6, 1.1)))
    lamp = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    lamp.data.energy, lamp.rotation_euler = 2.0, (0.6, 0.3, 0.4)
    scene.collection.objects.link(lamp)
    if all(skinned(thing) for thing in meshes):
        bpy.ops.mesh.primitive_plane_add(size=6, location=(centre.x, centre.y, 0))
        paint((0.2, 0.22, 0.25))
    scene.world = bpy.data.worlds.new("world")
    scene.world.color = (0.5, 0.5, 0.5)
    scene.view_settings.view_transform = "Standard"  # colours as they are in the file
    scene.render.engine, scene.cycles.device, scene.cycles.samples = "CYCLES", "CPU", SAMPLES
    scene.render.resolution_x, scene.render.resolution_y = 400, 400
    scene.render.filepath = case["picture"]
    bpy.ops.render.render(write_still=True)


def look(at: Any, place: Any) -> None:
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = place, (at - place).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def sticks(armature: Any) -> None:
    """What BVH lacks to be rendered: a cone from each bone's head to its tail."""
    for bone in armature.pose.bones:
        head, tail = (armature.matrix_world @ end for end in (bone.head, bone.tail))
        length = (tail - head).length
        bpy.ops.mesh.primitive_cone_add(radius1=0.035, radius2=0.01, depth=length, location=(head + tail) / 2)
        bpy.context.object.rotation_euler = (tail - head).to_track_quat("Z", "Y").to_euler()
        paint((0.7, 0.35, 0.1))


def paint(colour: tuple[float, float, float]) -> None:
    """Give the thing that was added last a matt colour."""
    material = bpy.data.materials.new("paint")
    material.diffuse_color = (*colour, 1.0)
    bpy.context.object.data.materials.append(material)


if __name__ == "__main__":
    main(*map(Path, sys.argv[-2:]))
