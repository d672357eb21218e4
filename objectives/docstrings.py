"""What docstrings of Google's style say about each name of a section."""

from __future__ import annotations


def meanings(text: str, *headings: str) -> dict[str, str]:
    """The section under one of the headings, such as ``Args:``, of a docstring without its indentation, by name.

    An entry of several names, ``times, positions: ...``, is about each of them.
    """
    found: dict[str, str] = {}
    current: list[str] = []
    inside = False
    for line in text.splitlines():
        if line.strip() in headings:
            inside = True
        elif inside and line and not line.startswith(" "):
            break
        elif inside and line.strip():
            head, colon, rest = line.strip().partition(":")
            names = head.split(", ")
            if colon and all(name.isidentifier() for name in names) and len(line) - len(line.lstrip()) <= 4:
                current = names
                found |= dict.fromkeys(names, rest.strip())
            elif current:
                found |= {name: f"{found[name]} {line.strip()}" for name in current}
    return found
