"""Solids cut from solids are closed, and as large as the sum says."""

from __future__ import annotations

import numpy as np
import pytest

from scenes.errors import UserError
from scenes.mesh.csg import csg
from scenes.mesh.mesh import Mesh
from scenes.mesh.primitives import Box, Plane


def test_csg_volumes() -> None:
    def volume(mesh: Mesh) -> float:
        a, b, c = np.moveaxis(mesh.triangles, 1, 0)
        return float((a * np.cross(b, c)).sum() / 6)

    left, right = Box((0, 0, 0), (1, 1, 1)), Box((0.5, 0, 0), (1, 1, 1))
    assert volume(csg("union", left, right)) == pytest.approx(1.5)
    assert volume(csg("intersection", left, right)) == pytest.approx(0.5)
    assert volume(csg("difference", left, right)) == pytest.approx(0.5)
    doorway = csg("difference", left, Box((0, -0.2, 0), (0.3, 0.8, 2.0)), Box((0, 0.3, 0), (0.3, 0.1, 2.0)))
    assert volume(doorway) == pytest.approx(1 - 0.3 * 0.7 - 0.3 * 0.1)
    assert volume(csg("union", doorway)) == pytest.approx(volume(doorway))  # a CSG result is a part again


def test_csg_refuses_what_is_no_solid() -> None:
    box = Box((0, 0, 0), (1, 1, 1))
    sheet = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), name="sheet")
    inverted = Mesh(box.mesh().vertices, box.mesh().faces[:, ::-1])
    with pytest.raises(UserError, match=r"part 1 \('sheet'\) is not a closed solid"):
        csg("union", box, sheet)
    with pytest.raises(UserError, match="facing outward"):
        csg("union", inverted)
    with pytest.raises(UserError, match="plane"):
        csg("difference", box, Plane((0, 0, 0)))
    with pytest.raises(UserError, match="did you mean 'union'"):
        csg("onion", box)
    with pytest.raises(UserError, match="at least one"):
        csg("union")
    with pytest.raises(UserError, match="leaves nothing"):
        csg("intersection", box, Box((5, 0, 0), (1, 1, 1)))
