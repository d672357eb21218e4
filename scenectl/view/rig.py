"""Pictures of characters and robots with the capsules that stand for them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from scenectl.view.camera import Sight, choose, triangles_to_vtk
from scenectl.view.picture import SIZE, add_light, load_pyvista, look_from, set_stage, write_png
from scenectl.view.shapes import CLAY
from scenes.body.proxies import Proxies
from scenes.body.rig import Rig

_COLOURS = ("#2f7d6b", "#c8642b", "#3f6fb0", "#a5842a", "#7a5ea8", "#b0446a")


def draw_proxies(rig: Rig, proxies: Proxies, png: str | Path, size: tuple[int, int] = SIZE) -> None:
    """A character at rest and the glassy capsules around it, a colour a link, as a PNG file."""
    pv = load_pyvista(off_screen=True)
    plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
    set_stage(plotter)
    plotter.enable_anti_aliasing("ssaa")  # multisampling and depth peeling exclude each other
    plotter.enable_depth_peeling(8)  # glass behind glass
    ends = proxies.place(proxies.frames).numpy()
    radii = proxies.radii.numpy()
    corners = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3), axis=-1).reshape(-1, 3)  # of the box around each end's ball
    reach = (ends[:, :, None] + radii[:, None, None, None] * corners).reshape(-1, 3)
    extent = float(np.ptp(reach, axis=0).max())
    camera = choose(reach, Sight(np.zeros((0, 3, 3)), False), np.zeros(2), size[0] / size[1], room=0.06 * extent)
    look_from(plotter, camera)
    plotter.add_mesh(triangles_to_vtk(rig.triangles), color=CLAY, ambient=0.36, diffuse=0.75, specular=0.03)
    colours = {part.link: _COLOURS[k % len(_COLOURS)] for k, part in enumerate(proxies.parts)}
    for (a, b), radius, link in zip(ends, radii, proxies.owners, strict=True):
        plotter.add_mesh(
            _capsule(pv, a, b, max(float(radius), 1e-3 * extent)), color=colours[link], opacity=0.35,
            smooth_shading=True, ambient=0.3, specular=0.2,
        )  # fmt: skip
    add_light(plotter, camera)
    write_png(plotter, png)


def _capsule(pv: Any, a: np.ndarray, b: np.ndarray, radius: float) -> Any:
    """A capsule whose facets lie around it, not within, so that a surface that fills it stays behind glass."""
    length = float(np.linalg.norm(b - a))
    shape = pv.Capsule(
        center=((a + b) / 2).tolist(), direction=(b - a).tolist() if length > 0 else (0.0, 1.0, 0.0),
        radius=radius / np.cos(np.pi / 60) ** 2, cylinder_length=length, resolution=60,
    )  # fmt: skip
    return shape
