"""Where `BUNDLED` was until `scenes.BUNDLED`; kept for scripts written against the first examples."""

from scenes.world.scene import BUNDLED as BUNDLED
