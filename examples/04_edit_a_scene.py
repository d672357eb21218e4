"""Move a chair and ask how much room there is now: only what the chair changes is baked again.

python examples/04_edit_a_scene.py [SCENE_WITH_NAMED_OBJECTS OBJECT]
"""

import sys
import time

import numpy as np
import torch

import scenes

file, name = sys.argv[1:3] if len(sys.argv) > 2 else (scenes.BUNDLED / "living_room.glb", "chair_1")
room = scenes.Assembly(scenes.load_parts(file), lattice=96)
print(f"{len(room.names)} objects, among them {', '.join(room.names[:4])}.")

# How far from everything is the place where the chair stands, a hand's breadth above its middle?
low, high = room.mesh(name).bounds
place = torch.tensor((low + high) / 2)
print(f"With '{name}' there, the clearance at {place.numpy().round(2)} is {room.grid.distance(place):.2f} m.")

# A pose is a 4 x 4 matrix from the mesh as it was loaded to the world: here half a metre up, for all to see.
pose = np.eye(4)
pose[1, 3] = 0.5
began = time.perf_counter()
first, after = room.move(name, pose)
seconds = time.perf_counter() - began
share = np.prod(after - first) / np.prod(room.lattice.shape)
print(f"Moved up in {1000 * seconds:.0f} ms; what changed lies within {share:.0%} of the grid.")
print(f"Now it is {room.grid.distance(place):.2f} m.")

room.remove(name)
print(f"Without '{name}' it is {room.grid.distance(place):.2f} m.")

# Whatever was edited, the grid equals a bake from nothing, bit for bit.
print(f"Equal to a full bake: {torch.equal(room.grid.values, room.full().grid.values)}.")
