"""The stage: a VTK window with what stands in it, a camera and light. VTK is loaded when one is made."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scenectl.view.shapes import Hull
from scenes.errors import UserError
from scenes.files import atomic_write

SIZE = (1600, 1000)
"""Pixels of a picture."""
Colour = tuple[int, int, int]
INK: Colour = (64, 64, 60)
"""Of all writing."""
_BACK, _HORIZON = (0.957, 0.949, 0.933), (0.875, 0.898, 0.918)
_SAMPLES = 8
"""Samples of a pixel that are asked for; drivers give fewer (Mesa's software one 4)."""
_LAYERS = 8
"""Layers of glass behind each other that are told apart."""
_COMPRESSION = 3
"""Of PNG files: a tenth larger than at 6, in a third of the time."""


class Finish(NamedTuple):
    """How a surface takes light: shares of ambient, diffuse and specular; an unlit one shows its colour as it is."""

    ambient: float = 0.36
    diffuse: float = 0.75
    specular: float = 0.03
    lit: bool = True


MATT, GLOW = Finish(), Finish(0.0, 1.0, 0.0, False)


class Stage:
    """What is drawn: surfaces, lines and writing by name, in world metres.

    Attributes:
        size: pixels of the picture.
        actors: what was given a name, as VTK actors.
    """

    def __init__(self, size: tuple[int, int] = SIZE, off_screen: bool = True, glass: bool = False) -> None:
        """Open an empty stage.

        Args:
            size: pixels.
            off_screen: for a picture, not for a window.
            glass: draw glass behind glass in its right order, at the price of rendering layer by layer.
        """
        _check_drawing(off_screen)
        try:
            import vtkmodules.vtkRenderingFreeType  # registers itself as the renderer of writing
            import vtkmodules.vtkRenderingOpenGL2  # noqa: F401  (registers itself as the renderer of all else)
            from vtkmodules.vtkRenderingCore import vtkRenderer, vtkRenderWindow
        except ImportError as error:
            raise UserError(
                f"pictures need VTK, which cannot be loaded ({error}); install its libraries with: apt-get install "
                "libgl1 libx11-6 libxrender1"
            ) from error
        self.size, self.actors = size, dict[str, Any]()
        self.renderer: Any = vtkRenderer(gradient_background=True, background=_BACK, background2=_HORIZON)
        self.window: Any = vtkRenderWindow(off_screen_rendering=off_screen)
        # Multisampling and layers of glass exclude each other: those are drawn large and made small.
        self._larger = 2 if glass else 1
        self.window.size = (self._larger * size[0], self._larger * size[1])
        self.window.multi_samples = 0 if glass else _SAMPLES
        self.window.AddRenderer(self.renderer)
        if glass:
            self.window.alpha_bit_planes = True
            self.renderer.use_depth_peeling, self.renderer.maximum_number_of_peels = True, _LAYERS

    # ---- what is on it ----------------------------------------------------------------------------------------

    def add(
        self, hull: Hull, colour: np.ndarray | Colour, finish: Finish = MATT, opacity: float = 1.0, name: str = "",
        below: float = np.inf,
    ) -> None:  # fmt: skip
        """A surface; what already has the name is replaced.

        Args:
            hull: its triangles, shaded by its normals where it has any, else facet by facet.
            colour: sRGB 0 to 255, one or one for each corner, ``[V, 3]`` or with opacity ``[V, 4]``.
            finish: how it takes light.
            opacity: of all of it, 0 to 1.
            name: by which it is found again, or none.
            below: height (m) above which it is cut away.
        """
        faces = np.arange(len(hull.points)).reshape(-1, 3) if hull.faces is None else hull.faces
        actor = self._add(polydata(hull.points, faces, hull.normals), colour, name)
        look = actor.property
        look.opacity, look.lighting, look.interpolation = opacity, finish.lit, 0 if hull.normals is None else 2  # Phong
        look.ambient, look.diffuse, look.specular = finish.ambient, finish.diffuse, finish.specular
        if np.isfinite(below):
            from vtkmodules.vtkCommonDataModel import vtkPlane

            actor.mapper.AddClippingPlane(vtkPlane(origin=(0.0, below, 0.0), normal=(0.0, -1.0, 0.0)))

    def add_lines(self, points: np.ndarray, lines: np.ndarray, colour: Colour, width: float, name: str = "") -> None:
        """Lines of some pixels: corners ``[V, 3]`` m, and which of them each joins, ``[L, 2]``."""
        look = self._add(polydata(points, lines), colour, name).property
        look.line_width, look.lighting = width, False

    def _add(self, data: Any, colour: np.ndarray | Colour, name: str) -> Any:
        from vtkmodules.util.numpy_support import numpy_to_vtk
        from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper

        mapper: Any = vtkPolyDataMapper()
        actor: Any = vtkActor(mapper=mapper)
        mapper.SetInputData(data)
        if isinstance(colour, np.ndarray):
            data.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(colour, dtype=np.uint8), deep=True))
            mapper.SetColorModeToDirectScalars()
            actor.property.specular_color = _share(colour[:, :3].mean(axis=0))
        else:
            actor.property.color = _share(colour)
        self._put(actor, name)
        return actor

    def add_text(self, text: str, place: tuple[float, ...], size: int) -> None:
        """Writing at a share of the picture, (0, 0) at its lower left, or from a world point (x, y, z) m on."""
        from vtkmodules.vtkRenderingCore import vtkTextActor

        actor: Any = vtkTextActor(input=text)
        where, look = actor.position_coordinate, actor.text_property
        (where.SetCoordinateSystemToWorld if len(place) == 3 else where.SetCoordinateSystemToNormalizedViewport)()
        where.SetValue(*place, *[0.0] * (3 - len(place)))
        look.font_size, look.color = size, _share(INK)
        self._put(actor, "")

    def add_scale(self, title: str, colours: str, limits: tuple[float, float], place: tuple[float, float]) -> None:
        """A legend of `shaded` at a share of the picture; one title is shown once."""
        from vtkmodules.vtkCommonCore import vtkLookupTable
        from vtkmodules.vtkRenderingAnnotation import vtkScalarBarActor

        table: Any = vtkLookupTable(number_of_table_values=256, table_range=limits)
        for i, colour in enumerate(shaded(np.linspace(0.0, 1.0, 256), colours, (0.0, 1.0))):
            table.SetTableValue(i, (*_share(colour), 1.0))
        bar: Any = vtkScalarBarActor(
            title=title, lookup_table=table, orientation=0, number_of_labels=5, position=place, position2=(0.25, 0.08),
            unconstrained_font_size=True,
        )  # fmt: skip
        for look, size in ((bar.title_text_property, 16), (bar.label_text_property, 14)):
            look.color, look.font_size = (0.0, 0.0, 0.0), size
            look.italic = look.bold = look.shadow = False
        self._put(bar, title)

    def _put(self, actor: Any, name: str) -> None:
        self.remove(name)
        if name:
            self.actors[name] = actor
        self.renderer.AddViewProp(actor)

    def remove(self, *names: str) -> None:
        """Take away what has these names, if anything has."""
        for name in names:
            if name in self.actors:
                self.renderer.RemoveViewProp(self.actors.pop(name))

    # ---- how it is looked at ----------------------------------------------------------------------------------

    def look_from(self, position: np.ndarray, target: np.ndarray, angle: float) -> None:
        """Look from a place at another (m, world) by light that comes with the camera.

        A key light over its left shoulder, a soft one from the right, and a little from above.

        Args:
            position: of the camera, ``[3]``.
            target: in the middle of the picture, ``[3]``.
            angle: vertical opening, degrees.
        """
        from vtkmodules.vtkRenderingCore import vtkLight

        active = self.renderer.active_camera
        active.position, active.focal_point = position.tolist(), target.tolist()
        active.view_up, active.view_angle = (0.0, 1.0, 0.0), angle
        back = position - target
        right = np.cross([0.0, 1.0, 0.0], back)
        scale = float(np.linalg.norm(back))
        right = right / max(float(np.linalg.norm(right)), 1e-9) * scale
        for offset, strength in (
            (back - 0.5 * right + [0.0, 0.7 * scale, 0.0], 0.62),
            (back + 0.9 * right + [0.0, 0.2 * scale, 0.0], 0.3),
            (np.array([0.0, scale, 0.0]) - 0.3 * back, 0.34),
        ):
            place = (target + offset).tolist()
            self.renderer.AddLight(vtkLight(position=place, focal_point=target.tolist(), intensity=strength))

    def render(self) -> None:
        """Draw what is on the stage now."""
        self.renderer.ResetCameraClippingRange()
        self.window.Render()

    def image(self) -> np.ndarray:
        """What the stage shows, ``[H, W, 3]`` uint8."""
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

        self.render()
        width, height, n = *self.size, self._larger
        pixels = vtkUnsignedCharArray()
        self.window.GetPixelData(0, 0, n * width - 1, n * height - 1, 0, pixels, 0)
        blocks = vtk_to_numpy(pixels).reshape(height, n, width, n, 3)[::-1]
        return blocks[:, 0, :, 0] if n == 1 else blocks.mean(axis=(1, 3)).round().astype(np.uint8)

    def write(self, png: str | Path) -> None:
        """What the stage shows as a PNG file, written whole or not at all; closes the stage."""
        from PIL import Image

        image = np.ascontiguousarray(self.image())
        self.close()
        with atomic_write(png) as file:
            Image.fromarray(image).save(file, format="PNG", compress_level=_COMPRESSION)

    def close(self) -> None:
        """Give the window's memory back."""
        self.window.Finalize()


def polydata(points: np.ndarray, cells: np.ndarray, normals: np.ndarray | None = None) -> Any:
    """Triangles or lines as VTK data, in their order: corners ``[V, 3]`` and cells ``[n, 3]`` or ``[n, 2]`` of them."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    def floats(values: np.ndarray) -> Any:
        return numpy_to_vtk(np.ascontiguousarray(values, dtype=np.float32), deep=True)

    links, corners = vtkCellArray(), np.ascontiguousarray(cells.ravel(), dtype=np.int64)
    links.SetData(cells.shape[1], numpy_to_vtkIdTypeArray(corners, deep=True))
    data = vtkPolyData(points=vtkPoints(data=floats(points)))
    (data.SetPolys if cells.shape[1] == 3 else data.SetLines)(links)
    if normals is not None:
        data.GetPointData().SetNormals(floats(normals))
    return data


def shaded(values: np.ndarray, colours: str, limits: tuple[float, float]) -> np.ndarray:
    """Colours ``[n, 3]`` (sRGB 0 to 255) of values between limits, those outside as at the limit.

    Args:
        values: ``[n]``.
        colours: of `SCALES`.
        limits: values of its first and its last colour.
    """
    anchors = np.array([list(bytes.fromhex(code)) for code in SCALES[colours].split()], dtype=np.float64)
    share = np.clip((values - limits[0]) / (limits[1] - limits[0]), 0.0, 1.0) * (len(anchors) - 1)
    return np.stack([np.interp(share, np.arange(len(anchors)), channel) for channel in anchors.T], axis=-1).round()


SCALES = {
    "bad to good": "a50026 d73027 f46d43 fdae61 fee08b ffffbf d9ef8b a6d96a 66bd63 1a9850 006837",
    "inside to outside": "67001f b2182b d6604d f4a582 fddbc7 f7f7f7 d1e5f0 92c5de 4393c3 2166ac 053061",
    "dark to bright": "0d0887 41049d 6a00a8 8f0da4 b12a90 cc4778 e16462 f2844b fca636 fcce25 f0f921",
}
"""Colours, evenly spaced: ColorBrewer's RdYlGn and RdBu (Brewer et al. 2003), and matplotlib's plasma."""

_OFF_SCREEN = {
    "libEGL.so.1": "vtkEGLRenderWindow",
    "libOSMesa.so.8": "vtkOSOpenGLRenderWindow",
    "libOSMesa.so.6": "vtkOSOpenGLRenderWindow",
}


def _check_drawing(off_screen: bool) -> None:
    """Choose what draws without a screen; raises UserError naming what to install where nothing can."""
    if off_screen and sys.platform == "linux" and not os.environ.get("DISPLAY"):
        # VTK would try the X server first, complain, and crash where nothing else is there
        window = next((kind for library, kind in _OFF_SCREEN.items() if _loads(library)), None)
        if window is None:
            raise UserError(
                "pictures need EGL to be drawn without a screen; install it with: apt-get install libegl1 libegl-mesa0 "
                "libgl1-mesa-dri"
            )
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", window)


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _share(colour: Colour | np.ndarray) -> tuple[float, ...]:
    """A colour's channels from 0 to 1."""
    return tuple(float(channel) / 255.0 for channel in colour)
