"""Goals written by users: registration, parameters, and errors of one sentence."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import pytest
import torch

from objectives import Masked, Objective, Term, forget, get_goal, goal, goals
from scenes.errors import UserError
from scenes.motion.motion import Motion
from tests.objectives.cases import context, wandering


@pytest.fixture(autouse=True)
def _clean() -> Iterator[None]:
    before = {spec.name for spec in goals()}
    yield
    for name in {spec.name for spec in goals()} - before:
        forget(name)


def keep_below_x() -> Any:
    @goal(unit="m")
    def keep_below_x(motion, context, *, x: float, joint: str = "pelvis"):  # type: ignore[no-untyped-def]
        """Keep `joint` on the -x side of the plane x (m, world).

        Args:
            x: where the plane is, m.
        """
        return (motion.joint(joint)[..., :1] - x).clamp_min(0)

    return keep_below_x


def test_a_goal_in_ten_lines() -> None:
    function = keep_below_x()
    spec = get_goal("keep_below_x")
    assert spec.summary == "Keep `joint` on the -x side of the plane x (m, world)."
    x, joint = spec.parameters.values()
    assert (x.type, x.required, x.doc) == ("a number", True, "where the plane is, m.")
    assert (joint.type, joint.default) == ("a text", "pelvis")
    motion = wandering()
    expected = (motion.joints[:, 15, 0] - 0.1).clamp_min(0)
    for use in ("keep_below_x", function):
        term = Term(use, {"x": 0.1, "joint": "head"}, weight=2)
        torch.testing.assert_close(term.cost(motion, context()), 2 * expected.square().sum())
    report = term.report(motion, context())[0]
    assert report.where == "head" and report.worst == pytest.approx(float(expected.max()))
    assert report.position == pytest.approx(motion.joints[int(expected.argmax()), 15].tolist())


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"jont": "head", "x": 1}, "goal 'keep_below_x': unknown parameter 'jont'; did you mean 'joint'?"),
        ({"wieght": 1, "x": 1}, "goal 'keep_below_x': unknown parameter 'wieght'; did you mean 'weight'?"),
        ({}, "goal 'keep_below_x': parameter 'x' is missing; it is a number (where the plane is, m.)"),
        ({"x": "1"}, "goal 'keep_below_x': parameter 'x' must be a number, not '1'"),
        ({"x": True}, "goal 'keep_below_x': parameter 'x' must be a number, not True"),
        ({"x": float("nan")}, "goal 'keep_below_x': parameter 'x' must be a number, not nan"),
        ({"x": 1, "joint": 3}, "goal 'keep_below_x': parameter 'joint' must be a text, not 3"),
        ({"x": 1, "weight": -1}, "goal 'keep_below_x': 'weight': input should be greater than or equal to 0, not -1"),
        ({"x": 1, "weight": "much"}, "goal 'keep_below_x': 'weight' must be a number, not 'much'"),
        (
            {"x": 1, "kernel": "cubic"},
            "goal 'keep_below_x': 'kernel' must be 'squared', 'linear', 'huber' or 'geman_mcclure', not 'cubic'",
        ),
        ({"x": 1, "window": [2, 1]}, "goal 'keep_below_x': 'window' must be [begin, end], not [2.0, 1.0]"),
        ({"x": 1, "sometime": [2, 1]}, "goal 'keep_below_x': 'sometime' must be [begin, end], not [2.0, 1.0]"),
        (
            {"x": 1, "sometime": [1, 2], "at": 1},
            "goal 'keep_below_x': 'sometime' finds the time itself; leave out 'at' and 'window'",
        ),
        ({"x": 1, "window": 3}, "goal 'keep_below_x': 'window' must be [number, number], not 3"),
        (
            {"x": 1, "name": "wall", "weights": [1], "at": [1, 2]},
            "goal 'wall' (keep_below_x): 'weights' needs one number for each time of 'at'",
        ),
    ],
)
def test_what_does_not_fit(table: dict[str, Any], sentence: str) -> None:
    keep_below_x()
    with pytest.raises(UserError) as caught:
        Term.from_table({"use": "keep_below_x", **table})
    assert str(caught.value) == sentence


def test_a_goal_of_earlier_versions_is_told_apart_from_a_name_that_was_never_one() -> None:
    with pytest.raises(UserError, match="goal 'bone_length' is gone: bones of all that is generated are rigid"):
        Term("bone_length")
    assert "bone_length" not in {spec.name for spec in goals()}


def test_unknown_goals_name_the_nearest() -> None:
    with pytest.raises(UserError, match="unknown goal 'joint_tarket'; did you mean 'joint_target'"):
        Term("joint_tarket")
    with pytest.raises(UserError, match="needs 'use'"):
        Term.from_table({"joint": "head"})
    with pytest.raises(UserError, match="decorate it"):
        Term(lambda motion, context: motion.joints)


def test_names_collide_unless_replaced() -> None:
    keep_below_x()
    with pytest.raises(UserError, match="'keep_below_x' is already registered"):
        keep_below_x()

    @goal(unit="m", name="keep_below_x", replace=True)
    def other(motion, context):  # type: ignore[no-untyped-def]
        return motion.joints[..., 0]

    assert get_goal("keep_below_x").function is other


def test_signatures_that_cannot_be_told_apart() -> None:
    def no_context(motion: Any) -> Any:
        return motion

    def untyped(motion, context, *, x):  # type: ignore[no-untyped-def]
        return motion

    def reserved(motion: Any, context: Any, *, weight: float) -> Any:
        return motion

    for function, message in (
        (no_context, "must start with"),
        (untyped, "'x' needs a name of its own and a type"),
        (reserved, "'weight' belongs to every table"),
    ):
        with pytest.raises(UserError, match=message):
            goal(unit="m")(function)


def test_wrong_residuals_are_named() -> None:
    @goal(unit="m")
    def too_flat(motion: Motion, context: Any) -> torch.Tensor:
        return motion.joints[..., 0, 0]

    @goal(unit="m", dim=2)
    def odd(motion: Motion, context: Any) -> torch.Tensor:
        return motion.joints[..., 0, :]

    @goal(unit="m")
    def wrong_mask(motion: Motion, context: Any) -> Masked:
        return Masked(motion.joints[..., 0, :], torch.ones(4, dtype=torch.bool))

    @goal(unit="m")
    def few_labels(motion: Motion, context: Any) -> Masked:
        return Masked(motion.joints[..., 0, :], labels=["x", "y"])

    motion = wandering(2)
    with pytest.raises(UserError, match=r"'too_flat': its function returned shape \(2, 9\), expected \[2, 9, 'k'\]"):
        Term("too_flat").cost(motion, context())
    with pytest.raises(UserError, match="'odd': its 3 components do not divide"):
        Term("odd").cost(motion, context())
    with pytest.raises(UserError, match="'few_labels': its labels must be as many as its 3 entries"):
        Term("few_labels").cost(motion, context())
    with pytest.raises(UserError, match="'wrong_mask': 'active' has shape"):
        Term("wrong_mask").cost(motion, context())


def test_types_in_words() -> None:
    @goal(unit="m")
    def many(
        motion: Any, context: Any, *, a: Literal["x", "y"] = "x", b: list[float] | None = None, c: tuple[int, ...] = ()
    ) -> Any:
        return motion.joints[..., 0, :]

    types = [p.type for p in get_goal("many").parameters.values()]
    assert types == ["'x' or 'y'", "a list of numbers", "a list of whole numbers"]
    assert (
        "kind = 'waypoints', 'line', 'arc', 'sinusoid' or 'array'" in get_goal("joint_target").parameters["track"].type
    )


def test_an_objective_from_tables_numbers_equal_names() -> None:
    objective = Objective.from_tables([{"use": "foot_contact"}, {"use": "smoothness"}, {"use": "foot_contact"}])
    assert [term.name for term in objective.terms] == ["foot_contact", "smoothness", "foot_contact 2"]
