"""What the bench of poses calls untouched."""

from __future__ import annotations

import pytest
import torch

from objectives import Context
from scenectl.bench.control.pose_goals import Followed
from scenectl.data.corpus import Clip
from scenectl.measures.believability.judge import Judge
from scenectl.measures.metrics import Scorer
from scenectl.pipeline.generation import Made
from scenes.body.body import DEFAULT_BODY
from scenes.motion.motion import Motion
from tests.objectives.cases import standing


@pytest.mark.parametrize(("aside", "untouched"), [(0.0, False), (1.5, True)])
def test_a_body_that_goes_through_the_pillar_between_two_frames_touches_it(aside: float, untouched: bool) -> None:
    """At 20 frames a second, a pillar of 30 cm lies between the frames of a body that is fast enough."""
    joints = standing(9, dtype=torch.float32)
    ways = torch.tensor([-4.8, -3.6, -2.4, -1.2, 0.0, 1.2, 2.4, 3.6, 4.8]) + 0.6
    joints[..., 2] += ways[:, None]
    clip = Clip("run", joints, ("a person runs",), "made", "test", "run", "CC0", True)
    asked = Followed(clip, 9, 0, (aside, 0.0))
    context, scorer = Context(asked.scene, DEFAULT_BODY), Scorer(asked.scene)
    motion = Motion(joints[None])
    assert float(scorer.depths(motion[0]).obstacles.max()) == 0.0
    figures = asked.figures(Made(motion, motion, None, {}), context, Judge(scorer).verdict(motion[0]))
    assert figures["untouched"] is untouched
