"""How commands show whether a robot can do what it is to do."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.console.console import out, table

if TYPE_CHECKING:
    from scenectl.retarget.robots.feasibility import Feasibility

_SHOWN = 6
"""Joints that are shown: those that use most of a limit."""


def show_feasibility(found: Feasibility) -> None:
    """The joints that use most of their limits in a table, and all else in sentences."""

    def share(used: float | None) -> str:
        return "-" if used is None else f"{used:.0%}"

    joints = sorted(found.joints, key=lambda j: -max(j.range_used or 0, j.speed_used, j.torque_used or 0))
    lines = table("joint", "range used", "speed (rad/s)", "of its limit", "torque (N m)", "of its limit")
    for joint in joints[:_SHOWN]:
        lines.add_row(
            joint.name,
            share(joint.range_used),
            f"{joint.speed:.1f}",
            share(joint.speed_used),
            f"{joint.torque:.0f}",
            share(joint.torque_used),
        )
    out.print(lines)
    out.print(f"{found.robot} for {found.seconds:.1f} s: " + ("no" if found.within else "a") + " limit is exceeded")
    for sentence in found.sentences():
        out.print("  " + sentence)
