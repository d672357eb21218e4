"""What is stated to rest on something counts as support where and while it does, and nowhere else."""

from __future__ import annotations

import numpy as np
import torch

from objectives import Term
from scenectl.measures.believability.evidence import Evidence
from scenectl.measures.metrics import Scorer
from scenes.body.body import DEFAULT_BODY
from scenes.mesh.primitives import Box
from scenes.motion.bones import standing_pose
from scenes.motion.motion import Motion
from scenes.motion.skeleton import HUMANML3D
from scenes.world.scene import Scene


def test_a_hand_on_a_table_supports_in_its_window() -> None:
    rest = standing_pose(HUMANML3D).float()
    rest = rest - rest[:, 1].min() * torch.tensor([0.0, 1.0, 0.0]) + torch.tensor([0.0, DEFAULT_BODY.sole_offset, 0.0])
    motion = Motion(rest.expand(40, -1, -1).clone(), fps=20.0)
    wrist = rest[HUMANML3D.index("left_wrist")].tolist()
    mine = np.array([owner == "left_wrist" for owner in DEFAULT_BODY.owners])
    points, radii = DEFAULT_BODY.points(motion)
    lowest = float((points[0, torch.from_numpy(mine), 1] - radii[torch.from_numpy(mine)]).min())
    table = Box((wrist[0], lowest - 0.5, wrist[2]), (0.3, 1.0, 0.3))
    scorer = Scorer(Scene(primitives=[table]))
    term = Term("contact", {"part": "left_hand"}, window=(0.0, 0.95))
    assert term.support == (("left_wrist",), (0.0, 0.95))

    def over(*supports: tuple[tuple[str, ...], tuple[float, float] | None]) -> np.ndarray:
        heights = Evidence.of(motion, scorer, supports=supports).carried.heights[:, 6:]
        found: np.ndarray = heights[:, mine].min(axis=1)
        return found

    assert (over() > 0.5).all()  # nothing but the ground is under what is not stated to rest
    rests = over(term.support)
    assert (rests[:20] < 0.01).all() and (rests[20:] > 0.5).all()
    assert (over((("right_wrist",), None)) > 0.5).all()
    assert (over((("left_wrist",), None)) < 0.01).all()
