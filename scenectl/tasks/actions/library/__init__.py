"""The actions that come with the package; importing this registers them."""

from scenectl.tasks.actions.library import going, hands, seats, staying, things

__all__ = ["going", "hands", "seats", "staying", "things"]
