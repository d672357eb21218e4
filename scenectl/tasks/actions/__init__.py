"""Actions: entries of a script, each a registered function that plans what it takes in a scene."""

from scenectl.tasks.actions import library as library
from scenectl.tasks.actions.registry import (
    ActionSpec as ActionSpec,
    action as action,
    actions as actions,
    forget as forget,
    get_action as get_action,
)
from scenectl.tasks.actions.state import Act as Act, State as State, World as World
