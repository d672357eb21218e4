"""The tables of report.json: what a run writes, and what is believed of a file that is read."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from scenes.errors import UserError
from scenes.world.floor.polyline import walked

FORMAT = 2
"""Version of report.json. The first knew no verdict: what is from then has None for it."""

Number = Annotated[float, Field(allow_inf_nan=False)]
Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]
"""Metres: no projection of the Earth has a coordinate over 2.1e7."""
Point = tuple[Coordinate, Coordinate, Coordinate]


class _Table(BaseModel):
    """A table of report.json: types as JSON has them; keys that are not known here are no fault."""

    model_config = ConfigDict(strict=True, frozen=True)


class PlaceTable(_Table):
    """Where a motion begins.

    Attributes:
        position: of the ground point under the pelvis, m, world.
        heading: radians about +y.
    """

    position: Point
    heading: Number


class WalkTable(_Table):
    """The planned walk.

    Attributes:
        path: on the ground, m, world.
        length_m: of it, as seen from above.
    """

    path: Annotated[tuple[Point, ...], Field(min_length=1)]
    length_m: Annotated[Number, Field(ge=0, le=10_000)]  # no walk of a minute is a hundredth of that

    @model_validator(mode="after")
    def _as_long_as_told(self) -> WalkTable:
        length = walked(np.array(self.path))
        if abs(length - self.length_m) > 0.1 + 0.01 * self.length_m:  # corners are rounded to 0.1 mm
            raise UserError(f"the path of the walk is {length:.4g} m long, and its length_m {self.length_m:.4g}")
        return self


class SceneTable(_Table):
    """The scene.

    Attributes:
        name, digest: of its geometry.
        floor_m: height of the floor, world; floor_found: in the mesh, rather than stated.
        bake: what was decided for each mesh; doubts: what may be wrong.
    """

    name: str
    digest: str
    floor_m: Number
    floor_found: bool
    bake: list[str]
    doubts: list[str] = []


class BodyTable(_Table):
    """The body that touched things.

    Attributes:
        source: of its measures; height_m: its stature; legs: how many times as long as an adult's they are; None in
            reports of before bodies had other sizes.
        sole_offset_m: height of the lowest foot joint over the sole; radii: of its parts.
    """

    source: str
    height_m: Number | None = None
    legs: Number | None = None
    sole_offset_m: Number
    radii: list[dict[str, Any]]


class TermTable(_Table):
    """How well a sample meets one goal, see `objectives.report.TermReport`; None is not a number or never active."""

    name: str
    goal: str
    unit: str
    worst: Number | None
    mean: Number | None
    tolerance: Number
    met: bool
    cost: Number | None
    weight: Number
    when: Number | None = None
    where: str | None = None
    position: tuple[Number | None, Number | None, Number | None] | None = None
    active_frames: int


class FindingTable(_Table):
    """One thing that no person does, see `scenectl.measures.believability.verdict.Finding`."""

    check: str
    value: Number | None
    limit: Number | None
    unit: str
    at_s: Number | None
    part: str | None
    sentence: str


class VerdictTable(_Table):
    """What the judge says.

    Attributes:
        sentence: the worst finding, or "believable".
        findings: the worst first; figures: of every check, by name with its unit.
        exempted: what goals let touch the scene, and how deep it went.
    """

    sentence: str
    findings: list[FindingTable]
    figures: dict[str, Number | None]
    exempted: list[str]


class SeriesTable(_Table):
    """A number for each frame; None where there is none, as of a goal where it is not active.

    Attributes:
        clearance_m: from each part of the body to the nearest obstacle, negative inside.
        speed_m_per_s: of the pelvis.
        support: what carries the body.
        residuals: of each goal, by its name: the worst entry's, in the goal's unit.
    """

    clearance_m: dict[str, list[Number | None]] = {}
    speed_m_per_s: list[Number | None] = []
    support: list[Literal["both", "left_foot", "right_foot", "other", "flight", "none"]] = []
    residuals: dict[str, list[Number | None]]


class SampleTable(_Table):
    """One motion.

    Attributes:
        rank: place in this list and in motion.npz, 0 is the best; sample: which of the generator's it was.
        cost, unrefined_cost: of the objective, at the end and before refinement.
        pose_change_m: by which refinement moved joints as seen from the pelvis, in the mean.
        met: every goal is, within its tolerance; diagnosis: why not.
        believable: a person would move like that; verdict: why not. None in results of format 1, as is `series`.
        start: where it begins.
        terms: the goals.
        metrics: figures of `scenectl.measures.metrics.measure`.
    """

    rank: int
    sample: int
    cost: Number
    unrefined_cost: Number | None = None
    pose_change_m: Number | None = None
    met: bool
    believable: bool | None = None
    diagnosis: str | None = None
    verdict: VerdictTable | None = None
    start: PlaceTable | None = None
    terms: list[TermTable]
    metrics: dict[str, Number | str | None]
    series: SeriesTable | None = None


class GeneratorTable(_Table):
    """What made the motions.

    Attributes:
        name: of the family; weights: "default", "permissive" or a folder, None where they were handed in.
        licence: of what the weights make; trace: the generator's own figures.
    """

    name: str
    weights: str | None = None
    licence: str
    trace: dict[str, Any]


class RefinementTable(_Table):
    """What refinement did.

    Attributes:
        solver: that was taken; passes: evaluations of the decoder; ended: why, for each of the generator's samples.
    """

    solver: str
    passes: int
    ended: list[str]


class MachineTable(_Table):
    """What a seed does not decide.

    Attributes:
        threads: that torch computed with.
        instruction_set: of the processor that torch used (`torch.backends.cpu.get_cpu_capability`).
    """

    threads: int
    instruction_set: str


class EditTable(_Table):
    """Which frames of which motion `scenectl edit` made anew, and how far (m) bones of one length moved those kept."""

    regenerated_frames: list[int]
    kept_moved_m: Number | None = None
    motion: str | None = None


class TaskDump(_Table):
    """The task: `Task(**task)` builds it again, as far as its scene comes from files, and says what is wrong with it.

    Attributes:
        prompt: the sentence, or tables of several; None for a script of actions.
        folder: where relative paths are looked for.
    """

    model_config = ConfigDict(extra="allow")

    prompt: str | list[dict[str, Any]] | None
    folder: str | None = None


class ReportTable(_Table):
    """report.json: metres, seconds and radians throughout, in world coordinates.

    Attributes:
        format: of this file; scenectl: the version that wrote it.
        prompt, seconds, fps, seed: as asked for.
        start: planned; a sample's own is with it.
        walk: planned, or None.
        scene, body, generator, refinement, machine: what took part; generator and refinement are None in scores.
        samples: the best first.
        timing: seconds of each part of the run.
        task: what was asked for.
        edit: of an edit.
    """

    format: Literal[1, 2]
    scenectl: str
    prompt: str
    seconds: Number
    fps: Number
    seed: int
    start: PlaceTable
    walk: WalkTable | None
    scene: SceneTable
    body: BodyTable
    samples: Annotated[list[SampleTable], Field(min_length=1)]
    task: TaskDump
    generator: GeneratorTable | None
    refinement: RefinementTable | None = None
    machine: MachineTable | None = None
    timing: dict[str, Number]
    edit: EditTable | None = None
