"""Moments of a preview are called by words."""

from __future__ import annotations

import pytest

from scenectl.measures.believability.checks import CHECKS
from scenectl.view.moments import called


@pytest.mark.parametrize("check", [check.name for check in CHECKS])
def test_findings_are_called_by_words(check: str) -> None:
    words = called(check)
    assert words and words.replace(" ", "").isalpha() and check.startswith(words.split()[0])
