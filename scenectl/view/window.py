"""The window: a picture to turn around, with a slider for time and keys for what is shown."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

import numpy as np

from scenectl.view.labels import plain
from scenectl.view.picture import Picture
from scenectl.view.stage import Look, open_stage, say
from scenes.errors import UserError

if TYPE_CHECKING:
    from pyvista import Plotter

_HELP = "s slice   c clearance   left/right one frame   q leave"


def open_window(picture: Picture, show_slice: bool = False, show_signs: bool = False) -> None:
    """Open a window with a time slider; s shows or hides the slice, c the clearances. Blocks until closed."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UserError("there is no screen to open a window on; use --png FILE")
    Window(picture, open_stage(off_screen=False), show_slice, show_signs).stage.show()


class Window:
    """The state of the window: which frame, and what is switched on."""

    def __init__(self, picture: Picture, stage: Plotter, show_slice: bool = False, show_signs: bool = False) -> None:
        """Fill a stage with what the window shows, its sliders and keys."""
        self.picture, self.stage = picture, stage
        self.frame, self.clearance, self.slice, self.height = 0, False, show_slice, picture.hip_height
        moments = picture.moments(None)
        camera = picture.look(moments, stage.window_size[0] / stage.window_size[1])
        picture.set_stage(stage, camera, [moment.frame for moment in moments[:1]], show_signs)
        if picture.title:
            say(stage, plain(picture.title), (0.015, 0.945), 12)
        if (motion := picture.motion) is not None:
            span, start = (motion.t0, float(motion.times[-1])), motion.t0
            stage.add_slider_widget(self.at, rng=span, value=start, title="time (s)", **_between(0.35, 0.95))
            stage.add_key_event("c", self.toggle_clearance)
            stage.add_key_event("Right", lambda: self.step(1))
            stage.add_key_event("Left", lambda: self.step(-1))
        stage.add_key_event("s", self.toggle_slice)
        span, start = (picture.level, picture.level + 2.0), self.height
        stage.add_slider_widget(self.at_height, rng=span, value=start, title="slice (m)", **_between(0.03, 0.25))
        say(stage, _HELP, (0.005, 0.005), 9)
        self.redraw()

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
        now, picture, stage = self.picture.time(self.frame), self.picture, self.stage
        stage.suppress_rendering = True
        picture.draw_moving(stage, [now])
        if picture.motion is not None:
            picture.draw_body(stage, self.frame, self.clearance, name="body")
        if self.slice:
            picture.draw_slice(stage, self.height, now)
        else:
            stage.remove_actor(["slice", "slice surface"])
        stage.suppress_rendering = False
        stage.render()


def _between(left: float, right: float) -> Look:
    """The look of a slider between two shares of the width, near the upper edge: legends stand near the lower one."""
    ends, thin = {"pointa": (left, 0.87), "pointb": (right, 0.87)}, {"slider_width": 0.02, "tube_width": 0.004}
    return {"color": "black", "title_height": 0.02, **ends, **thin}
