"""Bake a scene into signed distances, ask for some, and find a way through it.

python examples/01_bake_a_scene.py [MESH]
"""

import sys

import numpy as np
import torch

import scenectl as sc

scene = sc.load_scene(sys.argv[1]) if len(sys.argv) > 1 else sc.bundled("living_room", resolution=96)
for sentence in scene.report():  # what was decided about free space
    print(sentence)
print(f"The floor lies at {scene.floor.height:.3f} m.")

# Distances are metres, positive in free space, and differentiable.
points = torch.tensor([[-0.8, 0.9, 1.4], [0.0, 0.9, 0.0]], requires_grad=True)
distance = scene.distance(points)
distance.sum().backward()
for point, d, gradient in zip(points.tolist(), distance.tolist(), points.grad.tolist(), strict=True):
    away = ", ".join(f"{g:+.2f}" for g in gradient)
    print(f"At {point} the nearest surface is {d:.2f} m away; the way out is ({away}).")

# Where a person of 0.3 m radius can stand, and how to get from one place to another.
area = sc.free_area(scene, radius=0.3)
print(f"A person can stand on {area.square_metres:.1f} square metres of the floor.")
start, goal = area.sample(2, np.random.default_rng(1))
try:
    path = area.path(start, goal)
    print(f"From {start.round(2)} to {goal.round(2)}: {np.linalg.norm(np.diff(path, axis=0), axis=1).sum():.2f} m.")
except sc.UserError as error:
    print(error)
