"""Draws docs/architecture.png: python docs/draw_architecture.py."""

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

SCENES, OBJECTIVES, SCENECTL, FILE = "#d9e6df", "#f3e3c4", "#d8e0ee", "#f7f5f0"
BOXES = {
    "task": (0.1, 5.2, "task.toml\n+ scene files", FILE),
    "schema": (2.45, 5.2, "tasks.schema\nkeys, types", SCENECTL),
    "setup": (4.8, 5.2, "tasks.setup\nscene read, way\nplanned, goals checked", SCENECTL),
    "scene": (4.8, 3.1, "scenes.world.Scene\ndistance(points, time)\nscenes.body.ProxyBody", SCENES),
    "objective": (7.15, 3.1, "objectives.Objective\nresidual → cost, rows,\nreport, marks, targets", OBJECTIVES),
    "guide": (7.15, 1.1, "control.guidance\nlog_prob, gradient\nof a Step", SCENECTL),
    "generator": (9.65, 1.1, "generators.<family>\nprompts, start,\nconditions → Draft", SCENECTL),
    "refine": (12.1, 1.1, "control.refine\nstages: Solution →\nSolution; polish", SCENECTL),
    "rank": (12.1, 3.1, "measures, pipeline.rank\nscored from triangles,\nbest first", SCENECTL),
    "result": (12.1, 5.2, "pipeline.results\nmotion.npz, report.json\npreview.png (view)", FILE),
}
ARROWS = [
    ("task", "schema", ""), ("schema", "setup", ""), ("setup", "scene", ""), ("setup", "objective", ""),
    ("scene", "objective", "context"), ("objective", "guide", ""), ("guide", "generator", "tilts each step"),
    ("generator", "refine", "last step"), ("refine", "rank", "Motion"),
    ("rank", "result", ""),
]  # fmt: skip
WIDTH, HEIGHT = 1.75, 1.1


def anchor(name: str, other: str) -> tuple[float, float]:
    """Where an arrow between two boxes leaves the first."""
    (x, y, *_), (a, b, *_) = BOXES[name], BOXES[other]
    across, up = a - x, b - y
    if abs(across) * HEIGHT > abs(up) * WIDTH:
        return x + WIDTH / 2 * (1 + (across > 0) - (across < 0)), y + HEIGHT / 2
    return x + WIDTH / 2, y + HEIGHT / 2 * (1 + (up > 0) - (up < 0))


def main() -> None:
    """Boxes, arrows and a legend."""
    figure = Figure(figsize=(14, 6.6), layout="constrained")
    axis = figure.subplots()
    axis.set(xlim=(0, 14), ylim=(0.4, 6.9))
    axis.axis("off")
    for x, y, text, colour in BOXES.values():
        axis.add_patch(FancyBboxPatch((x, y), WIDTH, HEIGHT, "round,pad=0.06", facecolor=colour, edgecolor="#55585c"))
        axis.text(x + WIDTH / 2, y + HEIGHT / 2, text, ha="center", va="center", fontsize=9.5)
    for a, b, text in ARROWS:
        begin, end = anchor(a, b), anchor(b, a)
        axis.add_patch(
            FancyArrowPatch(begin, end, arrowstyle="-|>", mutation_scale=14, color="#55585c", shrinkA=5, shrinkB=5)
        )
        if text:
            axis.text(
                (begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2 + 0.12, text, fontsize=8, ha="center", color="#333"
            )
    # Refinement asks the same objective: along the gap between the rows.
    begin, end, gap = BOXES["objective"][0] + 1.4, BOXES["refine"][0] + 0.4, 2.65
    axis.plot([begin, begin, end], [BOXES["objective"][1], gap, gap], color="#55585c", linewidth=1)
    down = (end, gap), (end, BOXES["refine"][1] + HEIGHT)
    axis.add_patch(FancyArrowPatch(*down, arrowstyle="-|>", mutation_scale=14, color="#55585c", shrinkA=0, shrinkB=5))
    for i, (colour, text) in enumerate(
        (
            (SCENES, "scenes: what exists"),
            (OBJECTIVES, "objectives: what is wanted"),
            (SCENECTL, "scenectl: how it is reached"),
        )
    ):
        axis.add_patch(
            FancyBboxPatch((0.2, 2.6 - 0.6 * i), 0.35, 0.3, "round,pad=0.03", facecolor=colour, edgecolor="#55585c")
        )
        axis.text(0.75, 2.75 - 0.6 * i, text, va="center", fontsize=9.5)
    figure.savefig(Path(__file__).with_name("architecture.png"), dpi=90)


if __name__ == "__main__":
    main()
