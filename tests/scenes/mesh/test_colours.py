from __future__ import annotations

from pathlib import Path

import numpy as np

from scenes.mesh.colours import face_colours, linear
from scenes.mesh.glb import Item, glb
from scenes.mesh.mesh import load_mesh


def test_light_is_linear_in_halves_as_the_standard_has_it() -> None:
    np.testing.assert_allclose(linear(np.array([0, 10, 188, 255])), [0.0, 10 / 255 / 12.92, 0.5029, 1.0], atol=1e-4)
    assert (np.diff(linear(np.arange(256))) > 0).all()


def test_colours_of_a_file_come_back(tmp_path: Path) -> None:
    from manifold3d import Manifold

    (tmp_path / "box.glb").write_bytes(glb([Item("box", Manifold.cube([1.0, 1.0, 1.0]), (200, 90, 60))]))
    found = face_colours(load_mesh(tmp_path / "box.glb"))
    assert np.abs(found.astype(int) - (200, 90, 60)).max() <= 2  # trimesh keeps light in 8 bits
