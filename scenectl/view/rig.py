"""Pictures of characters and robots with the capsules that stand for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scenectl.view.camera import Sight, choose, look_from
from scenectl.view.shapes import capsules, facets
from scenectl.view.stage import MATT, ROUND, SIZE, open_stage, shot, write
from scenes.body.proxies import Proxies
from scenes.body.rig import Rig
from scenes.mesh.colours import CLAY

_COLOURS = ((47, 125, 107), (200, 100, 43), (63, 111, 176), (165, 132, 42), (122, 94, 168), (176, 68, 106))
_OUTSIDE = 1 / np.cos(np.pi / 60) ** 2
"""By how much facets are moved out to lie around a capsule and not within, so that what fills it stays behind glass."""


def draw_proxies(rig: Rig, proxies: Proxies, png: str | Path) -> None:
    """A character at rest and the glassy capsules around it, a colour a link, as a PNG file."""
    stage = open_stage(glass=True)
    ends = proxies.place(proxies.frames).numpy()
    radii = proxies.radii.numpy()
    corners = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)  # of the box around each end's ball
    reach = (ends[:, :, None] + radii[:, None, None, None] * corners).reshape(-1, 3)
    extent = float(np.ptp(reach, axis=0).max())
    camera = choose(reach, Sight(np.zeros((0, 3, 3)), False), np.zeros(2), SIZE[0] / SIZE[1], room=0.06 * extent)
    look_from(stage, camera)
    stage.add_mesh(facets(rig.triangles), color=CLAY, **MATT)
    colours = {part.link: _COLOURS[k % len(_COLOURS)] for k, part in enumerate(proxies.parts)}
    for (a, b), radius, link in zip(ends, radii, proxies.owners, strict=True):
        thick = _OUTSIDE * max(float(radius), 1e-3 * extent)
        glass = capsules(a[None], b[None], np.full((1, 2), thick))
        stage.add_mesh(glass, color=colours[link], opacity=0.35, ambient=0.3, specular=0.2, **ROUND)
    write(shot(stage), png)
