"""Edits of finished motions by any generator that is an `Editor`: what is kept comes back exactly, seams are smooth.

The editor keeps what it can (for MSCoT: tokens, as in MoSa, section IV-D), refinement draws the kept frames beside
each seam onto the original and the whole motion towards its goals, and what then remains of a jump is spread over the
frames made anew. The motion keeps its own lengths: what is kept is put on rigid bones that are fitted to it, and the
editor sees it on its own skeleton. Motions longer than an editor makes at once are edited in windows, each beginning
where frames are known: those kept, or those that the window before has made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from scenectl.control import Figure, FigureGuide, ObjectiveGuide
from scenectl.control.settings import SolverSettings
from scenectl.control.solvers.choice import minimise
from scenectl.control.solvers.problem import Problem, judged
from scenectl.generators import registry
from scenectl.generators.base import Draft, Generator, Guide, Progress, Step
from scenectl.generators.prompts import Prompts
from scenectl.generators.spec import Spec
from scenectl.pipeline.parts import PartGuide, Window, windows_over
from scenectl.pipeline.results import Result
from scenectl.pipeline.run import score
from scenectl.pipeline.seams import BESIDE, settled
from scenectl.tasks.schema import BodySpec, SceneSpec
from scenectl.tasks.setup import start_of
from scenectl.tasks.task import Task
from scenectl.threads import threads
from scenes.body.body import DEFAULT_BODY, LARGEST, SHORTEST, SMALLEST, STATURE, TALLEST
from scenes.errors import UserError
from scenes.motion.fitting import skeleton_of
from scenes.motion.frames import Place, origin_near
from scenes.motion.motion import Motion
from scenes.motion.rigid import rigid
from scenes.motion.skeleton import FEET

SIGMA = 0.03
"""Distance (m) from the original, root mean square of the joints, that counts half a nat a frame."""
NEAR = 0.3
"""Distance (m) from the place that a window of a longer gap shall end at that counts half a nat: half a step."""


def edit(
    generator: Generator,
    motion: Motion,
    regenerate: Bool[Tensor, " T"],
    prompt: Prompts | str,
    guide: Guide | None = None,
    samples: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    iterations: int = 40,
    origin: Place | None = None,
) -> Draft:
    """Make parts of one motion anew.

    Args:
        generator: one that can edit.
        motion: ``[T, J, 3]`` metres, world, on the generator's clock and of its joints, no longer than it makes any.
        regenerate: the frames to make anew; what the motion holds there is of no account.
        prompt: what the motion shall be: one sentence, or several with their times.
        guide: further goals, for the whole motion as it is seen from `origin`.
        samples, seed, progress: as for `Generator.generate`.
        iterations: refinement steps.
        origin: where the frame begins (m, world) in which all is computed; by default at the whole hundreds of metres
            near its first pelvis (`scenes.motion.frames.origin_near`), where that is far from the world's.

    Returns:
        Motions ``[samples, T, J, 3]`` on one skeleton (`on_own_bones`), equal to the one given in every frame kept as
        far as its bones have one length; without a step to refine further.

    Raises:
        UserError: a generator that cannot edit, or a motion or mask that is not as described.
    """
    editor = registry.editing(generator)
    check(motion, regenerate, generator.spec)
    prompts = Prompts.of(prompt)
    prompts.check(motion.frames / motion.fps)
    prompts = prompts.act_by_act(motion.frames / motion.fps)
    origin = origin_near(motion.joint("pelvis")[0].tolist()) if origin is None else origin
    whole, solver = on_own_bones(motion.seen_from(origin), ~regenerate), SolverSettings(iterations=iterations)
    ground, theirs = _ground(whole, ~regenerate), generator.spec.skeleton
    there, back = Figure.between(whole.skeleton, theirs, ground), Figure.between(theirs, whole.skeleton, ground)
    edits, trace = [whole], {}

    def made(motion: Motion, window: Window, count: int, seed: int) -> list[Motion]:
        part, inside = window.of(motion), window.inside
        others = None if guide is None else PartGuide(guide, motion, window)
        keeping = SeamGuide(part, ~inside, others, window.toward(motion))
        told = keeping if back is None else FigureGuide(keeping, back)
        given = part if there is None else there.of(part)
        said = prompts.within(window.start / motion.fps, window.end / motion.fps)
        draft = editor.edit(given, inside, said, guide=told, samples=count, seed=seed, progress=progress)
        trace.update(draft.trace)
        fitted = draft.motion if draft.step is None else refined(draft.step, told, solver)
        fitted = fitted if back is None else back.of(fitted)
        several = window.put(motion, rigid(settled(part, fitted, inside)).joints)
        return [several[k] for k in range(count)]

    with threads():
        for k, window in enumerate(windows_over(regenerate, generator.spec.window_frames)):
            count = samples if k == 0 else 1  # from the first window on each sample goes its own way
            edits = [new for s, old in enumerate(edits) for new in made(old, window, count, _seed(seed, k, s))]
    joints = torch.stack([motion.joints for motion in edits])
    batch = replace(whole, joints=joints, valid=whole.valid.expand(joints.shape[:2]))
    return Draft(batch.moved(origin), None, trace)


def on_own_bones(motion: Motion, kept: Bool[Tensor, " T"]) -> Motion:
    """One motion ``[T, J, 3]`` on a skeleton with the lengths of its kept frames, of which none changes any more."""
    fitted = skeleton_of(replace(motion, joints=motion.joints[kept], valid=motion.valid[kept]))
    return rigid(motion, fitted)


def _ground(motion: Motion, kept: Bool[Tensor, " T"]) -> tuple[float, float, float]:
    """Where (m) the body stands in the first kept frame: under its pelvis, as high as its lower foot."""
    frame = int(kept.int().argmax())
    x, _, z = motion.joint("pelvis")[frame].tolist()
    return x, float(motion.select(FEET)[frame, :, 1].min()), z


def _seed(seed: int, window: int, sample: int) -> int:
    """The seed itself in the first window, and others of its own in each further one."""
    return seed if window == 0 else int(np.random.SeedSequence([seed, window, sample]).generate_state(1)[0])


def mask_of(motion: Motion, spans: Sequence[tuple[float, float]]) -> Bool[Tensor, " T"]:
    """The frames of spans of seconds, each from its start to before its end; raises UserError for one past the end.

    Seconds are those of the motion's clock, on which its first frame is at `t0`.
    """
    mask = torch.zeros(motion.frames, dtype=torch.bool)
    for start, end in spans:
        first, last = (round((time - motion.t0) * motion.fps) for time in (start, end))
        if first < 0 or last > motion.frames:
            lasts = f"which lasts {motion.seconds:g} s" if motion.t0 == 0 else f"{motion.t0:g} to {motion.seconds:g} s"
            raise UserError(f"{start:g}-{end:g} goes beyond the motion, {lasts}")
        mask[first:last] = True
    return mask


def edited(
    generator: Generator,
    motion: Motion,
    regenerate: Bool[Tensor, " T"],
    prompt: Prompts | str,
    samples: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    task: Task | None = None,
) -> Result:
    """The edits that `edit` makes, measured and ranked.

    Args:
        generator, motion, regenerate, prompt, samples, seed, progress: as `edit` takes them.
        task: scene, body and goals, which guide what is made and are measured; by default there is only the floor that
            the kept frames stand on, and a person with legs as long.
    """
    check(motion, regenerate, generator.spec)
    if task is None:
        height = round(STATURE * on_own_bones(motion, ~regenerate).skeleton.legs / DEFAULT_BODY.skeleton.legs, 2)
        body = None if height == STATURE else BodySpec(height=min(max(height, SHORTEST), TALLEST))
        task = Task(prompt=prompt, seconds=motion.seconds, body=body)
        floor = float(motion.joints[~regenerate][..., 1].min()) - task.load_body().sole_offset
        task = task.model_copy(update={"scene": SceneSpec(floor=floor)})
    task = task.told(prompt).model_copy(update={"seconds": task.seconds or motion.seconds})
    with task.named():
        setup = task.build(start=start_of(motion, task.load_body()), spec=generator.spec)
        setup.objective.check(setup.context, motion.seconds, motion.fps, motion.t0)
    guide = None
    if setup.objective.counted:
        guide = ObjectiveGuide(setup.objective, setup.context, task.guidance, on_ground=True)
    made = edit(generator, motion, regenerate, prompt, guide, samples, seed, progress, origin=setup.origin)
    result = score(made.motion, task, progress, setup=setup)
    result.report["seed"] = seed
    result.report["generator"] = {"name": generator.name, "licence": generator.licence, "trace": {}}
    moved = (made.motion.joints - motion.joints)[:, ~regenerate].norm(dim=-1).max()
    result.report["edit"] = {
        "regenerated_frames": regenerate.nonzero().flatten().tolist(),
        "kept_moved_m": round(float(moved), 5),
    }
    return result


def check(motion: Motion, regenerate: Bool[Tensor, " T"], spec: Spec) -> None:
    """Raises UserError for a motion or mask that cannot be edited."""
    if motion.joints.ndim != 3:
        raise UserError(f"the motion has shape {tuple(motion.joints.shape)}; an edit takes one motion, [T, J, 3]")
    if motion.skeleton.names != spec.skeleton.names:
        raise UserError(
            f"the motion has another skeleton; an edit takes the generator's {len(spec.skeleton.names)} joints"
        )
    if motion.fps != spec.fps:
        raise UserError(
            f"the motion has {motion.fps:g} frames a second; an edit takes {spec.fps:g}: take motion.resampled first"
        )
    low, high = spec.shortest_frames, round(spec.longest * spec.fps)
    if not low <= motion.frames <= high:
        raise UserError(f"the motion has {motion.frames} frames; an edit takes {low} to {high}")
    if not motion.valid.all() or not torch.isfinite(motion.joints).all():
        raise UserError("the motion holds padding or positions that are not finite; cut it to its real frames first")
    if regenerate.shape != (motion.frames,):
        raise UserError(f"the mask has shape {tuple(regenerate.shape)}; the motion has {motion.frames} frames")
    if not regenerate.any():
        raise UserError("the edit makes no frame anew; name a part of the motion to regenerate")
    if regenerate.all():
        raise UserError("the edit keeps no frame; leave some, or generate a motion from the prompt alone")
    size = on_own_bones(motion, ~regenerate).skeleton.legs / spec.skeleton.legs
    if not SMALLEST <= size <= LARGEST:
        raise UserError(
            f"the motion's legs are {size:.2f} times as long as an adult's; an edit takes people of {SMALLEST:g} to "
            f"{LARGEST:g} times that: check the file's unit"
        )


class SeamGuide:
    """A guide towards the kept frames beside the seams, in the world, and towards another guide's goals.

    Where a window makes the beginning of a longer gap, `toward` says where its last frame shall be (x, z, m).
    """

    def __init__(
        self,
        motion: Motion,
        kept: Bool[Tensor, " T"],
        others: Guide | None = None,
        toward: Float[Tensor, "2"] | None = None,
    ) -> None:
        self.others, self.toward = others, toward
        self.frames = torch.nonzero(kept & near(~kept, BESIDE)).flatten()
        self.goal = motion.joints[self.frames]

    def cost(self, motion: Motion) -> Float[Tensor, " S"]:
        """Squared distance from the original, over the variance that `SIGMA` says, mean over joints."""
        away = (motion.joints[:, self.frames] - self.goal).square().sum(-1).mean(-1)
        cost = away.sum(-1) / (2 * SIGMA**2)
        if self.toward is None:
            return cost
        left = motion.joint("pelvis")[:, -1, [0, 2]] - self.toward
        return cost + left.square().sum(-1) / (2 * NEAR**2)

    def log_prob(self, step: Step) -> Float[Tensor, " S"]:
        kept = -self.cost(step.decode(step.value))
        return kept if self.others is None else kept + self.others.log_prob(step)

    def gradient(self, step: Step) -> Float[Tensor, "S *v"]:
        value = step.value.detach().requires_grad_(True)
        with torch.enable_grad():
            (gradient,) = torch.autograd.grad(-self.cost(step.decode(value)).sum(), value)
        gradient = torch.nan_to_num(gradient, 0.0, 0.0, 0.0)
        return gradient if self.others is None else gradient + self.others.gradient(step)


def refined(step: Step, guide: Guide, solver: SolverSettings) -> Motion:
    """The motion that a guide finds likeliest near a step's own value."""
    if solver.iterations == 0:
        return step.motion
    shape, start = step.value.shape, step.value.detach().flatten(1)
    cost = judged(lambda x: -guide.log_prob(step.at(x.unflatten(1, shape[1:]))))
    problem = Problem(cost, start, unit=step.unit)
    return step.at(minimise(problem, solver).value.unflatten(1, shape[1:])).motion


def near(mask: Bool[Tensor, " T"], frames: int) -> Bool[Tensor, " T"]:
    """Where the mask is true at most so many frames away."""
    wide: Tensor = torch.nn.functional.max_pool1d(mask.float()[None], 2 * frames + 1, stride=1, padding=frames)[0]
    return wide > 0
