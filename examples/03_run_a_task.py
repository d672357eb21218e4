"""Run a task from Python and look at what came out.

python examples/03_run_a_task.py [TASK.toml] [FOLDER]
"""

import sys
from pathlib import Path

import scenectl as sc

file = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / "tasks" / "walk_to_target.toml"
folder = sys.argv[2] if len(sys.argv) > 2 else "out/example"

task = sc.load_task(file)
result = sc.run(task, samples=2, seed=1)
result.save(folder)  # motion.npz, report.json, preview.png

best = result.samples[0]
for term in best.terms:
    print(term.sentence())
print(f"A person would {'' if best.believable else 'not '}move like that: {best.verdict.sentence}.")
print(f"Deepest in an obstacle: {1000 * best.metrics['deepest_penetration_m']:.0f} mm.")
print(f"Joints: {tuple(result.motion.joints.shape)} = samples, frames, joints, xyz in metres; files are in {folder}.")
