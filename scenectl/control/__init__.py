"""Control: goals become a guide that generators can follow."""

from scenectl.control.guide import ObjectiveGuide
from scenectl.control.settings import GuidanceSettings, SolverSettings
from scenectl.control.start import FreeStart

__all__ = ["FreeStart", "GuidanceSettings", "ObjectiveGuide", "SolverSettings"]
