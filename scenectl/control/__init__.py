"""Control: goals become a guide that generators can follow."""

from scenectl.control.guide import ObjectiveGuide
from scenectl.control.settings import GuidanceSettings, SolverSettings

__all__ = ["GuidanceSettings", "ObjectiveGuide", "SolverSettings"]
