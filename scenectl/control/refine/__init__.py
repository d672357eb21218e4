"""Refinement: a draft's last step is solved for the goals, as far as a body allows, and polished in joints."""

from scenectl.control.refine.polish import SmoothStep
from scenectl.control.refine.refinement import Refined, refine

__all__ = ["Refined", "SmoothStep", "refine"]
