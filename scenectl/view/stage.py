"""The stage: a plotter of pyvista's with background and finishes of all pictures. It is loaded when one is opened."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scenes.errors import UserError
from scenes.files import atomic_write

if TYPE_CHECKING:
    from PIL.Image import Image
    from pyvista import Plotter

SIZE = (1600, 1000)
"""Pixels of a picture."""
INK = (64, 64, 60)
"""Of all writing."""
Look = dict[str, Any]
"""Arguments of `Plotter.add_mesh`."""
MATT: Look = {"ambient": 0.36, "diffuse": 0.75, "specular": 0.03}
ROUND: Look = {"interpolation": "phong"}
"""Shaded by the normals of corners instead of facet by facet."""
_BACK, _HORIZON = "#f4f2ee", "#dfe5ea"
_SAMPLES = 8
"""Samples of a pixel that are asked for; drivers give fewer (Mesa's software one 4)."""
_LAYERS = 8
"""Layers of glass behind each other that are told apart."""
_COMPRESSION = 3
"""Of PNG files: a tenth larger than at 6, in a third of the time."""
_OFF_SCREEN = {
    "libEGL.so.1": "vtkEGLRenderWindow",
    "libOSMesa.so.8": "vtkOSOpenGLRenderWindow",
    "libOSMesa.so.6": "vtkOSOpenGLRenderWindow",
}


def open_stage(size: tuple[int, int] = SIZE, off_screen: bool = True, glass: bool = False) -> Plotter:
    """An empty stage.

    Args:
        size: pixels.
        off_screen: for a picture, not for a window.
        glass: draw glass behind glass in its right order, at the price of rendering layer by layer.

    Raises:
        UserError: nothing can draw here; names what to install.
    """
    if off_screen and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        # VTK would try the X server first, complain, and crash where nothing else is there
        window = next((kind for library, kind in _OFF_SCREEN.items() if _loads(library)), None)
        if window is None:
            raise UserError(
                "pictures need EGL to be drawn without a screen; install it with: apt-get install libegl1 libegl-mesa0 "
                "libgl1-mesa-dri"
            )
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", window)
    try:
        from pyvista import Plotter
    except ImportError as error:
        raise UserError(
            f"pictures need VTK, which cannot be loaded ({error}); install its libraries with: apt-get install libgl1 "
            "libx11-6 libxrender1"
        ) from error
    stage = Plotter(off_screen=off_screen, window_size=list(size), lighting="none")
    stage.set_background(_BACK, top=_HORIZON)
    if glass:  # multisampling and layers of glass exclude each other
        stage.enable_anti_aliasing("ssaa")
        stage.enable_depth_peeling(_LAYERS)
    else:
        stage.enable_anti_aliasing("msaa", multi_samples=_SAMPLES)
    return stage


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def scaled(title: str, colours: str, limits: tuple[float, float], across: float) -> Look:
    """The look of what is coloured by values, with a legend.

    Args:
        title: of the legend, and the name of the values in the surface.
        colours: matplotlib's name of a scale.
        limits: values of its first and its last colour.
        across: share of the picture's width at which the legend begins.
    """
    # its height is left to pyvista, which then removes it with the surface
    legend = {"title": title, "color": "black", "n_labels": 2, "position_x": across, "height": 0.1, "width": 0.25}
    # values that were interpolated past the edge of a facet would be drawn as a seam
    look = {"cmap": colours, "clim": limits, "interpolate_before_map": False}
    return {"scalars": title, "scalar_bar_args": legend, **look}


def shot(stage: Plotter) -> np.ndarray:
    """What a stage shows, ``[h, w, 3]`` sRGB; closes the stage."""
    image = np.asarray(stage.screenshot(return_img=True))
    stage.close()
    return image


def write(image: Image | np.ndarray, png: str | Path) -> None:
    """An image, or its ``[h, w, 3]`` sRGB values, as a PNG file, written whole or not at all."""
    from PIL import Image

    whole = Image.fromarray(image) if isinstance(image, np.ndarray) else image
    with atomic_write(png) as file:
        whole.save(file, format="PNG", compress_level=_COMPRESSION)


def say(stage: Plotter, text: str, position: tuple[float, float], height: int) -> None:
    """Write on a stage at a place (shares of its width and height); none of the text is markup."""
    words = text.replace("$", "\\$")  # VTK would hand what is between two of them to matplotlib as a formula
    stage.add_text(words, position=position, viewport=True, font_size=height, color=INK)
