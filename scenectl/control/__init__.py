"""Control: goals become a guide that generators can follow, and refinement of what they draft."""

from scenectl.control.figure import Figure, FigureGuide
from scenectl.control.guidance.guide import ObjectiveGuide
from scenectl.control.refine import Refined, refine
from scenectl.control.settings import GuidanceSettings, SolverSettings
from scenectl.control.start import FreeStart

__all__ = [
    "Figure",
    "FigureGuide",
    "FreeStart",
    "GuidanceSettings",
    "ObjectiveGuide",
    "Refined",
    "SolverSettings",
    "refine",
]
