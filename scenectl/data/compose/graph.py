"""Sequences of acts: clips cut where their poses and velocities match, and laid one after the other."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import KDTree
from torch import Tensor

from scenectl.data.compose.grammar import ActKind, act_of, may_follow, sentences
from scenectl.data.corpus import Act, Clip, combined, mirrored
from scenectl.data.features import FPS, canonicalise
from scenectl.data.seams import (
    HALF,
    accelerations,
    blended,
    floors,
    laid,
    planted,
    seam_ratio,
    seen_from_body,
    sliding,
    standing,
)
from scenectl.data.sentences import in_one
from scenes.motion.headings import heading
from scenes.motion.motion import Motion

FRAMES = (48, 196)
"""Frames of a sequence."""
STRETCH = (24, 70)
"""Frames of a steady act that are shown, 1.2 to 3.5 s."""
MOST, SHOWN = 4, 16
"""Acts in a sequence at most, and frames of each at least: less shows nothing."""
EDGE = 0.2
"""Share of an act shown whole that may be cut off at either end: people stand ready there."""
ALIKE = 0.13
"""Largest distance (m, root mean square over joints) of two frames that may meet, velocities counted over `HALF`."""
LEVEL = 0.05
"""Largest difference (m) of the floors that two pieces stand on; more is a step."""
SMOOTH = 1.3
"""Largest acceleration at a seam, over the 99th percentile elsewhere in the sequence."""
QUIET = 0.012
"""Accelerations (m/frame^2, 4.8 m/s^2) that pass at any seam: in a sequence that hardly moves, all are large."""
SLIDES = 0.1
"""Share of the frames at seams in which feet may slide beyond that elsewhere in the sequence."""
LIVELY = 0.7
"""Least motion of joints in a stretch of a steady act, as a share of the whole clip's: walkers stop at walls."""
SAME = 0.06
"""Largest difference (m) of the pelvis's mean height in a stretch of a steady act from that in the clip."""
NEIGHBOURS = 24
"""Frames looked at beside each that a piece may end (or begin) with."""
DOORS = 40
"""Frames at which one piece may be entered, or left, at most."""
CLIPS = 16
"""Clips that match best, of which the one shown least is taken."""
TRY = 0.05
"""What an attempt in vain counts for, where the kind of act shown least is the next: some match nothing."""
_DIMENSIONS = 24


@dataclass(frozen=True, eq=False)
class Piece:
    """A clip that a sequence may show.

    Attributes:
        clip: as recorded, found or edited.
        act: its kind.
        views: poses and velocities seen from the body, in few numbers whose distances are metres.
        floor: height of the floor under each frame (m).
    """

    clip: Clip
    act: ActKind
    views: Float[np.ndarray, "T D"]
    floor: Float[np.ndarray, " T"]

    def entries(self, end: int | None = None) -> range:
        """Frames at which it may be entered, given where it is left."""
        last = self.clip.frames - 1 - HALF
        if not self.act.steady:
            first = self.clip.acts[0].end - STRETCH[0] // 2 if self.clip.acts else last
            return range(HALF, max(HALF, min(first, round(EDGE * last))) + 1)
        if end is None:
            return range(HALF, last - STRETCH[0] + 1)
        return range(max(HALF, end - STRETCH[1]), end - STRETCH[0] + 1)

    def exits(self, begin: int | None = None) -> range:
        """Frames at which it may be left, given where it is entered."""
        last = self.clip.frames - 1 - HALF
        if not self.act.steady:
            first = self.clip.acts[-1].begin + STRETCH[0] // 2 if self.clip.acts else 0
            return range(min(last, max(first, round((1 - EDGE) * last))), last + 1)
        if begin is None:
            return range(STRETCH[0] + HALF, last + 1)
        return range(begin + STRETCH[0], min(last, begin + STRETCH[1]) + 1)

    def typical(self, begin: int, end: int) -> bool:
        """Whether a stretch shows what the captions say: of long takes some do not."""
        if not self.act.steady:
            return True
        joints = self.clip.joints
        motion = joints.diff(dim=0).norm(dim=-1).mean(-1)
        height = joints[:, 0, 1]
        lively = motion[begin:end].mean() > LIVELY * motion.mean()
        return bool(lively and abs(height[begin:end].mean() - height.median()) < SAME)


@dataclass
class Shown:
    """What a sequence shows of a piece: from frame `begin` up to `end`; None where that is still open."""

    piece: Piece
    begin: int | None = None
    end: int | None = None

    def closed(self, draw: random.Random) -> tuple[int, int]:
        """Its frames; open ends of steady acts are drawn, others are the clip's."""
        begin, end = self.begin, self.end
        length = draw.randint(*STRETCH) if self.piece.act.steady else self.piece.clip.frames
        if begin is None:
            begin = max(0, (end or 0) - length)
        return begin, min(self.piece.clip.frames, begin + length) if end is None else end


def views(joints: Float[Tensor, "T 22 3"], floor: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T 132"]:
    """Poses and velocities of all frames seen from the body; distances are root mean squares over joints (m)."""
    pose, step = seen_from_body(joints, heading(Motion(joints)))
    pose[..., 1] -= torch.from_numpy(floor)[:, None]
    step = torch.cat([step[:1], (step[:-1] + step[1:]) / 2, step[-1:]])
    seen: np.ndarray = torch.stack([pose, HALF * step], dim=1).flatten(1).numpy() / joints.shape[1] ** 0.5
    return seen


def basis(clips: Sequence[Clip]) -> Float[np.ndarray, "132 D"]:
    """Directions in which views of the clips differ most: distances along these are nearly all of the distances."""
    seen = np.concatenate([views(clip.joints, floors(clip.joints))[::8] for clip in clips])
    seen = seen - seen.mean(0)
    return np.linalg.eigh(seen.T @ seen)[1][:, -_DIMENSIONS:].astype(np.float32)


class Doors:
    """Frames of all pieces of one kind at which they may be entered, or left, and the search among them."""

    def __init__(self, pieces: Sequence[Piece], *, entered: bool) -> None:
        spans = [piece.entries() if entered else piece.exits() for piece in pieces]
        # Long takes have no more doors than others have, or all ways would lead through them.
        spans = [span[:: 1 + len(span) // DOORS] for span in spans]
        self.pieces = pieces
        self.piece = np.repeat(np.arange(len(pieces)), [len(span) for span in spans])
        self.frame = np.concatenate([np.asarray(span, int) for span in spans])
        self.floor = np.concatenate([piece.floor[list(span)] for piece, span in zip(pieces, spans, strict=True)])
        seen = [piece.views[list(span)] for piece, span in zip(pieces, spans, strict=True)]
        self.tree = KDTree(np.concatenate(seen)) if len(self.frame) else None

    def beside(self, seen: Float[np.ndarray, "N D"], floor: np.ndarray) -> list[tuple[float, int, Piece, int]]:
        """Distance, row of `seen`, piece and frame of doors that match some of the views and stand on their floor."""
        if self.tree is None or not len(seen):
            return []
        count = min(NEIGHBOURS, len(self.frame))
        far, door = self.tree.query(seen, k=count, distance_upper_bound=ALIKE)
        far, door = far.reshape(len(seen), -1), door.reshape(len(seen), -1)
        rows, columns = np.nonzero(np.isfinite(far))
        found = []
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            at = door[row, column]
            if abs(self.floor[at] - floor[row]) < LEVEL:
                found.append((float(far[row, column]), row, self.pieces[self.piece[at]], int(self.frame[at])))
        return found


class Graph:
    """All that clips can be joined to."""

    def __init__(self, clips: Sequence[Clip]) -> None:
        known = [(clip, act) for clip in clips if clip.frames >= STRETCH[0] and (act := act_of(clip)) is not None]
        directions = basis([clip for clip, _ in known[:: 1 + len(known) // 500]]) if known else np.empty((0, 0))
        self.pieces: dict[ActKind, list[Piece]] = {}
        for clip, act in known:
            floor = floors(clip.joints)
            seen = views(clip.joints, floor) @ directions
            self.pieces.setdefault(act, []).append(Piece(clip, act, seen, floor))
        self.used: Counter[str] = Counter()

    @cached_property
    def doors(self) -> dict[tuple[ActKind, bool], Doors]:
        return {
            (act, entered): Doors(those, entered=entered)
            for act, those in self.pieces.items()
            for entered in (True, False)
        }

    def sequence(self, focus: str, count: int, draw: random.Random) -> list[Shown] | None:
        """Some `count` pieces that match, one of which shows `focus`; None where nothing matches."""
        kinds = [act for act in self.pieces if act.name == focus]
        chain = [Shown(self._fresh(self.pieces[draw.choice(kinds)], draw))]
        before = draw.randint(0, count - 1)
        for ahead in [True] * (count - 1 - before) + [False] * before:
            if not self._extend(chain, ahead, draw):
                return None
        return chain

    def _fresh(self, pieces: Sequence[Piece], draw: random.Random) -> Piece:
        """One of those least used so far, of a few."""
        return min(draw.choices(pieces, k=4), key=lambda piece: self.used[piece.clip.id])

    def _extend(self, chain: list[Shown], ahead: bool, draw: random.Random) -> bool:
        """Put a piece after the chain, or before it."""
        edge = chain[-1] if ahead else chain[0]
        act = edge.piece.act
        fit = [k for k in self.pieces if (may_follow(act, k) if ahead else may_follow(k, act))]
        if not fit:
            return False
        alike = Counter(k.name for k in fit)  # of different things in the hands
        kind = draw.choices(fit, [k.weight / alike[k.name] for k in fit])[0]
        span = edge.piece.exits(edge.begin) if ahead else edge.piece.entries(edge.end)
        at = list(span)[:: max(1, len(span) // 12)]
        found = self.doors[kind, ahead].beside(edge.piece.views[at], edge.piece.floor[at])
        if not found:
            return False
        # Without this, a few clips would be the ends of all walks.
        best = list({each[2].clip.id: each for each in sorted(found, key=lambda each: -each[0])}.values())[-CLIPS:]
        _, row, piece, frame = min(best, key=lambda each: (self.used[each[2].clip.id], each[0]))
        if ahead:
            edge.end = at[row]
            chain.append(Shown(piece, begin=frame))
        else:
            edge.begin = at[row]
            chain.insert(0, Shown(piece, end=frame))
        return True


def composed(clips: Sequence[Clip], draw: random.Random, hours: float) -> list[Clip]:
    """Sequences of two to four acts, each up to 9.8 s long, with sentences that say them in order.

    Kinds of acts come evenly: each sequence is made around one, and others that may precede and follow it are joined
    to it where a pose and a velocity match. Sides are exchanged in half of the pieces, so that the sequences need no
    mirrored copies.

    Args:
        clips: recorded, found and edited ones; those whose label or captions say nothing of use are left out.
        draw: where choices come from; the same gives the same clips.
        hours: how much is made; less where few of the clips match.
    """
    graph = Graph([*clips, *map(mirrored, clips)])
    made: list[Clip] = []
    names = sorted({act.name for act in graph.pieces})
    seen = dict.fromkeys(names, 0.0)
    frames, vain = 0, 0
    while names and frames < hours * 3600 * FPS and vain < 200 * len(names):
        focus = min(names, key=lambda name: seen[name])
        chain = graph.sequence(focus, draw.choices([2, 3, 4], [0.5, 0.35, 0.15])[0], draw)
        clip = chain and _joined(chain, draw, len(made))
        if not clip:
            vain, seen[focus] = vain + 1, seen[focus] + TRY
            continue
        assert chain is not None
        graph.used.update(shown.piece.clip.id for shown in chain)
        for shown in chain:
            seen[shown.piece.act.name] += 1
        made.append(clip)
        frames, vain = frames + clip.frames, 0
    return made


def _joined(chain: Sequence[Shown], draw: random.Random, number: int) -> Clip | None:
    """The sequence as a clip; None where it is too long, or where a seam shows."""
    spans = [shown.closed(draw) for shown in chain]
    if not FRAMES[0] <= sum(end - begin for begin, end in spans) <= FRAMES[1]:
        return None
    if not all(shown.piece.typical(*span) for shown, span in zip(chain, spans, strict=True)):
        return None
    joints, stands, seams = _laid([shown.piece for shown in chain], spans)
    joints = planted(joints, stands, seams)
    if not _sound(joints, seams):
        return None
    pieces, edges = [shown.piece for shown in chain], [0, *seams, len(joints)]
    acts = tuple(
        act
        for piece, (begin, _), a, b in zip(pieces, spans, edges[:-1], edges[1:], strict=True)
        for act in _acts(piece, a - begin, a, b, draw)
    )
    if len(acts) > MOST or any(act.end - act.begin < SHOWN for act in acts):
        return None
    return Clip(
        id=f"composed{number:05d}~" + "+".join(piece.clip.id for piece in pieces),
        joints=canonicalise(joints),
        captions=in_one([act.captions for act in acts], most=3),
        split=pieces[0].clip.split,
        label=", ".join([*(piece.act.name for piece in pieces), "composed"]),
        acts=acts,
        **combined([piece.clip for piece in pieces]),
    )


def _acts(piece: Piece, moved: int, first: int, last: int, draw: random.Random) -> list[Act]:
    """What a piece shows between two frames of a sequence, in which it is `moved` frames later than in its clip."""
    own = piece.clip.acts or (Act(0, piece.clip.frames, piece.clip.captions),)
    edges = [first, *(act.end + moved for act in own[:-1]), last]
    texts = [draw.choice(sentences(act.captions, piece.act)) for act in own]
    return [Act(a, b, (text,)) for a, b, text in zip(edges[:-1], edges[1:], texts, strict=True)]


def _laid(
    pieces: Sequence[Piece], spans: Sequence[tuple[int, int]]
) -> tuple[Float[Tensor, "T 22 3"], np.ndarray, list[int]]:
    """Joints of pieces one after the other, which feet stand, and the middle frames of the blends."""
    (begin, end), first = spans[0], pieces[0]
    last = end + HALF + 1 if len(pieces) > 1 else end
    joints = first.clip.joints[begin:last]
    stands = standing(first.clip.joints, first.floor)[begin:last]
    level = float(first.floor[end]) if len(pieces) > 1 else 0.0
    seams: list[int] = []
    for i, (piece, (begin, end)) in enumerate(zip(pieces[1:], spans[1:], strict=True), start=1):
        stop = end + HALF + 1 if i + 1 < len(pieces) else end
        window = 2 * HALF + 1
        rise = level - float(piece.floor[begin])
        placed = laid(piece.clip.joints[begin - HALF : stop], joints[-window:], rise)
        stood = standing(piece.clip.joints, piece.floor)[begin - HALF : stop]
        seams.append(len(joints) - 1 - HALF)
        joints = torch.cat([joints[:-window], blended(joints[-window:], placed[:window]), placed[window:]])
        stands = np.concatenate([stands[:-HALF], stood[HALF + 1 :]])
        level = float(piece.floor[min(end, len(piece.floor) - 1)]) + rise
    return joints, stands, seams


def _sound(joints: Float[Tensor, "T 22 3"], seams: list[int]) -> bool:
    """Whether seams are as smooth as the rest, and feet slide no more at them."""
    near = np.zeros(len(joints), bool)
    for seam in seams:
        near[seam - HALF - 1 : seam + HALF + 2] = True
    slides = sliding(joints)
    if slides[near].mean() > slides[~near].mean() + SLIDES:
        return False
    return bool(accelerations(joints)[near].max() < QUIET) or seam_ratio(joints, seams) < SMOOTH
