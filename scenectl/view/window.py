"""The window: a picture to turn around, with a slider for time and keys for what is shown."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from scenectl.view.marks import draw_moving_marks
from scenectl.view.picture import Picture
from scenectl.view.stage import Stage
from scenes.errors import UserError

_HELP = "s slice   c clearance   left/right one frame   q leave"


def open_window(picture: Picture, show_slice: bool = False, show_signs: bool = False) -> None:
    """Open a window with a time slider; s shows or hides the slice, c the clearances. Blocks until closed."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UserError("there is no screen to open a window on; use --png FILE")
    Window(picture, Stage(off_screen=False), show_slice, show_signs).run()


class Window:
    """The state of the window: which frame, and what is switched on."""

    def __init__(self, picture: Picture, stage: Stage, show_slice: bool = False, show_signs: bool = False) -> None:
        """Fill a stage with what the window shows, its sliders and keys."""
        from scenectl.view.evidence import draw_evidence

        self.picture, self.stage = picture, stage
        self.frame, self.clearance, self.slice, self.height = 0, False, show_slice, picture.hip_height
        poses = picture.moments(None)
        picture.set_stage(stage, poses, poses[:1], [picture.time(0)], show_signs)
        if show_signs:
            draw_evidence(stage, picture.scene)
        self._controls = _Controls(stage)
        if (motion := picture.motion) is not None:
            span = (motion.t0, float(motion.times[-1]))
            self._controls.slider("time (s)", span, motion.t0, (0.35, 0.95), self.at)
            self._controls.keys |= {"c": self.toggle_clearance}
            self._controls.keys |= {"Right": lambda: self.step(1), "Left": lambda: self.step(-1)}
        self._controls.keys["s"] = self.toggle_slice
        floor = picture.scene.floor.height
        self._controls.slider("slice (m)", (floor, floor + 2.0), self.height, (0.03, 0.25), self.at_height)
        stage.add_text(_HELP, (0.005, 0.005), 18)
        self._show()

    def run(self) -> None:
        """Show it until it is closed."""
        self._controls.run()

    def at(self, seconds: float) -> None:
        """The time slider was moved."""
        assert self.picture.motion is not None
        self.frame = self.picture.motion.frame_at(seconds)
        self.redraw()

    def step(self, frames: int) -> None:
        """One frame on or back."""
        assert self.picture.motion is not None
        self.frame = int(np.clip(self.frame + frames, 0, self.picture.motion.frames - 1))
        self.redraw()

    def at_height(self, height: float) -> None:
        """The slice's slider was moved."""
        self.height = height
        self.redraw()

    def toggle_clearance(self) -> None:
        """Colour the body by its distance to the scene, or not."""
        self.clearance = not self.clearance
        self.redraw()

    def toggle_slice(self) -> None:
        """Show the distance field, or not."""
        self.slice = not self.slice
        self.redraw()

    def redraw(self) -> None:
        """Draw what moves, the body and the slice as they are now."""
        self._show()
        self.stage.render()

    def _show(self) -> None:
        now, picture = self.picture.time(self.frame), self.picture
        picture.room.draw_moving(self.stage, [now])
        draw_moving_marks(self.stage, picture.marks, picture.scene.floor.height, [now])
        if picture.motion is not None:
            picture.draw_body(self.stage, self.frame, self.clearance)
        if self.slice:
            picture.draw_slice(self.stage, self.height, now)
        else:
            self.stage.remove("slice", "slice surface", "distance (m)")


class _Controls:
    """What a hand does to a stage: turning it, sliders, keys.

    Attributes:
        keys: what is done when a key, by VTK's name for it, is pressed.
    """

    def __init__(self, stage: Stage) -> None:
        from vtkmodules.vtkInteractionStyle import vtkInteractorStyleTrackballCamera
        from vtkmodules.vtkRenderingCore import vtkRenderWindowInteractor
        from vtkmodules.vtkRenderingUI import vtkGenericRenderWindowInteractor

        on_screen = not stage.window.GetOffScreenRendering()
        self.keys: dict[str, Callable[[], None]] = {}
        self.interactor: Any = vtkRenderWindowInteractor() if on_screen else vtkGenericRenderWindowInteractor()
        self.interactor.SetRenderWindow(stage.window)
        style = vtkInteractorStyleTrackballCamera()
        style.AddObserver("CharEvent", lambda *_: None)  # in place of VTK's own keys, s for surfaces among them
        self.interactor.SetInteractorStyle(style)
        self.interactor.AddObserver("KeyPressEvent", self._pressed)
        self._stage, self._sliders = stage, list[Any]()  # VTK drops widgets without a reference

    def slider(
        self,
        title: str,
        limits: tuple[float, float],
        value: float,
        across: tuple[float, float],
        moved: Callable[[float], None],
    ) -> None:
        """A slider near the lower edge, between two shares of the width; `moved` is told its value when let go of."""
        from vtkmodules.vtkInteractionWidgets import vtkSliderRepresentation2D, vtkSliderWidget

        face: Any = vtkSliderRepresentation2D(
            minimum_value=limits[0], maximum_value=limits[1], value=value, title_text=title, slider_length=0.02,
            slider_width=0.02, tube_width=0.004, title_height=0.02, label_height=0.02,
        )  # fmt: skip
        for point, share in zip((face.GetPoint1Coordinate(), face.GetPoint2Coordinate()), across, strict=True):
            point.SetCoordinateSystemToNormalizedDisplay()
            point.SetValue(share, 0.08)
        face.slider_property.color = (0.0, 0.0, 0.0)
        face.tube_property.color = face.cap_property.color = (0.6, 0.6, 0.6)
        for look in (face.title_property, face.label_property):
            look.color, look.shadow, look.bold = (0.0, 0.0, 0.0), False, False
        widget: Any = vtkSliderWidget(
            interactor=self.interactor, representation=face, current_renderer=self._stage.renderer
        )
        widget.AddObserver("EndInteractionEvent", lambda *_: moved(face.GetValue()))
        widget.EnabledOn()
        self._sliders.append(widget)

    def run(self) -> None:
        """Hand over to the window until it is closed."""
        self.interactor.Initialize()
        self._stage.render()
        self.interactor.Start()

    def _pressed(self, *_: Any) -> None:
        key = self.interactor.GetKeySym()
        if key in ("q", "Escape"):
            self.interactor.TerminateApp()
        elif key in self.keys:
            self.keys[key]()
