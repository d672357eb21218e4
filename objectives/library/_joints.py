"""How goals are told joints: one name, several, or none for all of them."""

from __future__ import annotations

from scenes.motion import Motion

Joints = str | list[str]


def chosen(joints: Joints | None, motion: Motion) -> list[str]:
    """Names of the joints meant, all of the skeleton's for None."""
    if joints is None:
        return list(motion.skeleton.names)
    return [joints] if isinstance(joints, str) else list(joints)
