"""`scenectl bench skeletons`."""

from __future__ import annotations

from scenectl.bench.commands.shared import alone, shown
from scenectl.console.options import DATA, Data, Json


def skeletons(data: Data = DATA, json_file: Json = None) -> None:
    """Hips and collars of recorded people, by source, beside those of the body that motions are put on."""
    from scenectl.bench.studies.skeletons import bench_skeletons

    shown(
        alone(lambda engine: bench_skeletons(data, engine), json_file),
        json_file,
        (
            "source", "clips", "hip_deg", "hip_between_clips_deg", "hip_within_clip_deg", "collar_deg",
            "collar_between_clips_deg", "collar_within_clip_deg", "hip_moved_m", "collar_moved_m", "limb_ends_moved_m",
        ),
    )  # fmt: skip
