"""The clip of tasks/greet.toml and tasks/wave_while_walking.toml, as the script that makes it:
``python examples/make_clips.py [FOLDER]``.

A motion of our own, by the weights whose data allow any use: the right hand goes up, waves, and stays up.
"""

import sys
from pathlib import Path

import scenectl as sc

WAVE = {"kind": "sinusoid", "start": [-0.42, 1.72, 0.22], "end": [-0.42, 1.72, 0.22], "amplitude": [0.16, -0.02, 0.0]}
TASK = {
    "prompt": "a person raises the right hand and waves",
    "seconds": 4.0,
    "start": [0.0, 0.0],
    "samples": 4,
    "generator": {"weights": "permissive"},
    "goals": [
        {
            "use": "joint_target",
            "joint": "right_wrist",
            "track": {**WAVE, "cycles": 3.0, "times": [1.0, 3.6]},
            "tolerance": 0.03,
        },
        {"use": "foot_contact", "weight": 100.0, "kernel": "squared", "reduction": "sum"},
        {"use": "sdf_penetration", "weight": 300.0, "kernel": "squared", "reduction": "sum"},
    ],
}

if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "clips"
    folder.mkdir(exist_ok=True)
    result = sc.run(sc.Task(**TASK))
    print(result.samples[0].verdict.sentence)
    sc.export(result.motion[0], folder / "wave.bvh")
    print(f"{folder / 'wave.bvh'}  {(folder / 'wave.bvh').stat().st_size / 1024:.1f} kB")
