"""Motions longer than the model's: windows that cover, join and agree."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from scenectl.generators.mscot import sampling as mscot
from scenectl.generators.mscot.keeping import LONGEST, OVERLAP, closeness, covering
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.generators.prompts import Prompt, Prompts
from scenes.motion.motion import Pose2D
from tests.scenectl.small import Words, bundle, quantiser

HERE = Pose2D()


@pytest.mark.parametrize("tokens", [9, 48, 49, 50, 59, 88, 89, 100, 150, 299, 300])
def test_windows_cover_the_motion_with_lengths_that_the_model_knows(tokens: int) -> None:
    windows = covering(tokens)
    assert (windows.count == 1) == (tokens <= LONGEST) and 9 <= windows.length <= LONGEST
    assert windows.starts[0] == 0 and windows.starts[-1] + windows.length == tokens
    steps = [b - a for a, b in zip(windows.starts, windows.starts[1:], strict=False)]
    assert all(windows.length / 2 <= step <= windows.length - OVERLAP + 1 for step in steps)
    assert windows.count <= -(-tokens // (LONGEST - OVERLAP))  # no more than in proportion to the length
    assert (windows.fade >= 0).all()
    torch.testing.assert_close(windows.join(torch.ones(windows.count, 3, windows.length)), torch.ones(1, 3, tokens))


def test_windows_that_agree_join_to_what_they_were_cut_from() -> None:
    windows, whole = covering(130), torch.randn(2, 5, 130)
    parts = windows.split(whole)
    assert parts.shape == (2 * windows.count, 5, windows.length)
    torch.testing.assert_close(windows.join(parts), whole)
    assert windows.disagreement(parts).abs().max() < 1e-5
    parts[1] += 1.0
    away = windows.disagreement(parts)
    assert away[0].max() > 0.9 and away[1].min() < -0.9 and away[windows.count :].abs().max() < 1e-5
    rows = torch.randn(2 * windows.count, 7, 5)
    assert torch.equal(windows.rows(windows.series(rows)), rows)


@pytest.mark.parametrize("normalised", [True, False])
def test_the_closest_code_is_the_one_that_quantisation_takes(normalised: bool) -> None:
    made = quantiser(normalised=normalised)
    rest = torch.randn(3, 16, 20)
    for k in range(made.scales):
        got = closeness(made, k, rest, torch.ones(3, 20))
        assert torch.equal(got.argmax(-1), made.nearest(k, made.down(rest, made.lengths(20)[k])))
        assert not closeness(made, k, 0 * rest, torch.zeros(3, 20)).any()


def test_a_long_motion_has_its_length_and_a_seed_decides_it() -> None:
    generator = MSCoT(bundle())
    once, again, other = (generator.generate("a person walks", 12.35, HERE, samples=2, seed=s) for s in (1, 1, 2))
    assert once.motion.joints.shape == (2, 247, 22, 3) and torch.equal(once.motion.joints, again.motion.joints)
    assert (once.motion.joints - other.motion.joints).abs().max() > 1e-3


def test_neighbours_agree_the_more_the_surer_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    generator, seen = MSCoT(bundle()), list[float]()
    refinable = MSCoT._refinable

    def look(self: MSCoT, state: mscot._State) -> object:
        rows = [state.windows.rows(e) for e in state.refined]
        seen.append(float(state.windows.disagreement(self.quantiser.latent(rows, state.finest)).norm()))
        return refinable(self, state)

    monkeypatch.setattr(MSCoT, "_refinable", look)
    for seam in (0.0, 10.0):
        monkeypatch.setattr(mscot, "SEAM", seam)
        generator.generate("a person walks", 20.0, HERE, samples=4)
    assert seen[1] < 0.8 * seen[0]


def test_sixty_seconds_have_seams_no_rougher_than_the_rest() -> None:
    got = MSCoT(bundle()).generate("a person walks", 60.0, HERE).motion.joints[0]
    assert got.shape == (1200, 22, 3) and torch.isfinite(got).all()
    rough = (got[2:] - 2 * got[1:-1] + got[:-2]).norm(dim=-1).amax(-1)
    seam, windows = torch.zeros(1198, dtype=torch.bool), covering(300)
    for start, before in zip(windows.starts[1:], windows.starts, strict=False):
        middle = 2 * (start + before + windows.length)
        seam[middle - 12 : middle + 12] = True
    assert rough[seam].max() <= 1.2 * rough[~seam].max() and rough[seam].mean() <= 1.2 * rough[~seam].mean()


def test_every_window_is_told_its_own_stretch_of_the_timeline() -> None:
    generator, windows = MSCoT(bundle()), covering(125)
    prompts = Prompts((Prompt("A person walks"), Prompt("someone sits down", 4.0), Prompt("waves", 23.0)))
    text = generator._text(prompts, windows, samples=2)
    assert len(text.sentence) == 2 * 2 * windows.count and windows.count == 3
    known = {p.text: Words().encode([p.text.lower()]).sentence[0] for p in prompts.sentences}
    for row in range(2 * windows.count):
        first, length = windows.starts[row % windows.count], windows.length
        wanted = [p.text for p in prompts.spans() if 5 * p.begin < first + length and 5 * (p.end or 99) > first]
        found = [i for i in range(text.begin.shape[1]) if float(text.end[row, i] - text.begin[row, i]) > 0]
        assert len(found) == len(wanted)
        for i, said in zip(found, wanted, strict=True):
            torch.testing.assert_close(text.sentence[row, i], known[said])
        at = next(i for i, said in zip(found, wanted, strict=True) if said == "someone sits down")
        assert float(text.begin[row, at]) == 20 - first and float(text.end[row, at]) == 115 - first
    assert (text.owner[2 * windows.count :, 0] == 0).all() and (text.owner[2 * windows.count :, 1:] == -1).all()


def test_what_is_said_of_a_time_changes_the_motion_there_and_a_sentence_twice_is_once() -> None:
    generator = MSCoT(bundle())

    def made(*sentences: tuple[str, float]) -> Tensor:
        prompts = Prompts(tuple(Prompt(*each) for each in sentences))
        return generator.generate(prompts, 4.0, HERE).motion.joints[0]

    once = generator.generate("a person walks", 4.0, HERE).motion.joints[0]
    torch.testing.assert_close(made(("a person walks", 0.0), ("A person walks ", 1.7)), once, atol=1e-4, rtol=1e-4)
    assert (made(("a person walks", 0.0), ("jumps", 1.7)) - once).abs().max() > 1e-3
