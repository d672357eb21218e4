"""`scenectl body`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scenectl.console.console import doubt, err, out, table
from scenes.errors import UserError

if TYPE_CHECKING:
    from scenes.body.body import ProxyBody
    from scenes.body.proxies import Proxies


def body(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="A character (GLB, glTF), a robot (URDF, MJCF) or a fitted body."),
    ] = None,
    json_file: Annotated[Path | None, typer.Option("--json", help="Write the fitted capsules to this file.")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw the character and its capsules.")] = None,
    coverage: Annotated[float, typer.Option(help="Share of each link's surface inside its capsules, 0.5 to 1.")] = 1.0,
    max_capsules: Annotated[int, typer.Option(min=1, help="Capsules for each link, at most.")] = 1,
) -> None:
    """Fit capsules to a character or a robot; without FILE, print the radii of our body and their source."""
    if file is None:
        if json_file is not None or png is not None:
            raise UserError("--json and --png keep what is fitted to a FILE; give a URDF, MJCF or GLB file")
        from scenes.body.body import DEFAULT_BODY

        _show_body(DEFAULT_BODY)
        return
    from scenectl.data.characters import load_character
    from scenes.body.proxies import Proxies, fit_proxies

    if file.suffix.lower() == ".json":
        if png is not None:
            raise UserError(f"'{file}' holds capsules without a mesh; --png draws the GLB, URDF or MJCF file")
        proxies = Proxies.load(file)
    else:
        rig, joints = load_character(file)
        doubt(rig.doubts)
        with err.status("fitting"):
            proxies = fit_proxies(rig, coverage, max_capsules, joints)
    _show_proxies(proxies)
    if json_file is not None:
        proxies.save(json_file)
        out.print(f"wrote {json_file}")
    if png is not None:
        from scenectl.view.rig import draw_proxies

        draw_proxies(rig, proxies, png)
        out.print(f"wrote {png}")


def _show_body(body: ProxyBody) -> None:
    """The radii of a body for the 22 joints, and where they come from."""
    from scenes.body.body import SHORTEST, TALLEST

    lines = table("part", "radius (m)", "from")
    for row in body.table():
        lines.add_row(str(row["part"]), f"{row['radius_m']:.3f}", str(row["origin"]))
    out.print(lines)
    out.print(f"\nSource: {body.source}")
    out.print(_size(body))
    out.print(f"The sole lies {body.sole_offset:.3f} m below the lowest foot joint of a person at rest.")
    out.print(
        f"Tasks may state another height, body = {{ height = {SHORTEST:g} }} to {TALLEST:g} m: all is in proportion."
    )


def _show_proxies(proxies: Proxies) -> None:
    """Every link's capsules and how tightly they fit, and all together."""
    lines = table("link", "capsules", "radius (m)", "length (m)", "volume ratio", "of", "uncovered (mm)")
    for part in proxies.parts:
        lines.add_row(
            part.link,
            str(len(part.capsules)),
            " ".join(f"{capsule.radius:.3f}" for capsule in part.capsules),
            " ".join(f"{capsule.length:.3f}" for capsule in part.capsules),
            f"{part.volume_ratio:.2f}" if math.isfinite(part.volume_ratio) else "flat",
            part.reference,
            f"{1000 * part.uncovered:.1f}",
        )
    out.print(lines)
    ratio = f"{proxies.volume_ratio:.2f} times their volume" if math.isfinite(proxies.volume_ratio) else "all flat"
    out.print(
        f"{proxies.name}: {len(proxies.capsules)} capsules on {len(proxies.parts)} of {len(proxies.links)} "
        f"links, {ratio}, nothing more than {1000 * proxies.uncovered:.1f} mm outside"
    )
    if proxies.body is not None:
        out.print(f"as a body of our 22 joints: {proxies.body.source}\n{_size(proxies.body)}")


def _size(body: ProxyBody) -> str:
    """How large a body is, and the lengths of its bones."""
    from scenectl.measures.believability.words import bone_name

    skeleton = body.skeleton
    lengths = ", ".join(f"{bone_name(skeleton.names[b])} {skeleton.bone_lengths[b]:.3f}" for _, b in skeleton.bones)
    legs = f"legs of {skeleton.legs:.3f} m from the pelvis down, {body.size:.2f} times an adult's"
    return f"It is {body.height:.2f} m tall, with {legs}; bones (m): {lengths}."
