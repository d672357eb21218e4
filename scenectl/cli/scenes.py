"""`scenectl scenes`."""

from __future__ import annotations

from scenectl.console.console import out, titled


def scenes() -> None:
    """List the bundled scenes with their starts and targets."""
    import tomllib

    from scenes.world.scene import BUNDLED, bundled_names

    for name in bundled_names():
        facts = tomllib.loads((BUNDLED / f"{name}.toml").read_text(encoding="utf-8"))
        out.print(titled(name, f": {facts.get('notes', '')}"))
        places = {"start": facts.get("start", {}).get("position"), **facts.get("targets", {}), **facts.get("reach", {})}
        out.print("   " + "  ".join(f"{key} {value}" for key, value in places.items() if value))
