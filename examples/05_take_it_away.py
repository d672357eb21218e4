"""Take a motion away: files for animation tools and engines, and the joints of a robot where there is one.

python examples/05_take_it_away.py [FOLDER] [ROBOT.xml]
"""

import sys
from pathlib import Path

import scenectl as sc

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/example")
robot = sc.Robot(sys.argv[2]) if len(sys.argv) > 2 else None  # MJCF or URDF, with the extra `robots`

task = sc.Task(
    prompt="a person walks forward",
    seconds=2.0,
    scene=sc.bundled("pillars"),
    body=None if robot is None else {"height": robot.stature},  # a person with the robot's legs takes its steps
)
motion = sc.run(task, samples=1, seed=1).motion[0]
for name, stated in {
    "walk.glb": {"scene": task.load_scene()},  # the mannequin and the room, for Blender, Godot, Unity, Unreal
    "walk.bvh": {"names": "mixamo", "fps": 30},
    "walk.npz": {"layout": "joints"},
}.items():
    made = sc.export(motion, folder / name, **stated)
    print(f"{made.files[0]}: {made.animations[0].frames} frames of {len(made.animations[0].skeleton.names)} joints")
if robot is not None:
    found = robot.retarget(motion, fps=50)
    figures = found.figures()
    print(f"{robot.name}: {found.frames} frames, feet slide {100 * figures.slide:.1f} cm at most")
