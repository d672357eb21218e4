"""Solids that scripts make."""

from __future__ import annotations

import pytest

from scenes.authoring import Item, Plan, box, glb, join


def test_box_and_union_have_their_sizes_and_volumes() -> None:
    one, two = box((0.0, 1.0), (0.0, 2.0), (-1.0, 2.0)), box((0.5, 1.5), (0.0, 2.0), (-1.0, 2.0))
    assert one.volume() == pytest.approx(6.0)
    assert join(one, two).volume() == pytest.approx(9.0)  # what both fill counts once
    assert join(one, two).bounding_box() == pytest.approx((0.0, 0.0, -1.0, 1.5, 2.0, 2.0))


def test_a_plan_is_written_as_its_items() -> None:
    items = (Item("crate", box((0.0, 1.0), (0.0, 1.0), (0.0, 1.0)), (205, 176, 136)),)
    plan = Plan("one", "A crate.", items, (0.0, 0.0, 0.0), {"door": (1.0, 1.0)})
    assert glb(plan) == glb(items)
    assert glb(plan)[:4] == b"glTF"
