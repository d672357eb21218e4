"""Ablations on a tiny model: chunks join up, control is scored, pictures show what they say."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import torch

from scenectl.bench.models.asked import load_asked
from scenectl.bench.studies import ablations
from scenectl.bench.studies.ablations import ABLATIONS, ACTS_OF, LEARNT, SCHEDULES, Bench, controlled, in_chunks
from scenectl.bench.studies.figures import (
    _plane,
    draw_code_use,
    draw_scales,
    draw_spectrogram,
    draw_tilt,
    draw_trade_off,
    guided_scales,
    spectrogram,
)
from scenectl.control import SolverSettings
from scenectl.data.augment import GROUPS, Augmentation
from scenectl.data.clips import prepare
from scenectl.data.corpus import load_motions
from scenectl.data.kinds import EDITS
from scenectl.data.sources import HUMANML3D
from scenectl.evaluation.kinds import ACTS, KindClassifier
from scenectl.generators.mscot.sampling import MSCoT
from scenectl.networks.checkpoint import save_weights
from scenes.errors import UserError
from tests.scenectl.generators.mscot.training.test_train import TINY
from tests.scenectl.small import bundle
from tests.scenectl.training.folder import walks

PNG = b"\x89PNG"
CROUCHED = Augmentation.none(crouch=1.0)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walks(tmp_path_factory.mktemp("data"))


def test_schedules_are_those_of_table_9() -> None:
    assert all(len(s) == k and s[0] == 1 and s[-1] == 16 and sorted(set(s)) == list(s) for k, s in SCHEDULES.items())
    assert next(iter(ABLATIONS)) == "figures" and "iterations" in ABLATIONS


def test_chunks_are_reconstructed_one_by_one_and_cut_to_length() -> None:
    tokenizer = bundle().tokenizer
    features = torch.randn(2, 20, 263)
    torch.testing.assert_close(in_chunks(tokenizer, features, None), tokenizer.decode(tokenizer.encode(features)))
    got = in_chunks(tokenizer, features, 8)
    assert got.shape == features.shape
    torch.testing.assert_close(got[:, 8:16], tokenizer.decode(tokenizer.encode(features[:, 8:16])))
    filled = torch.cat([features[:, 16:], features[:, -1:].expand(-1, 4, -1)], 1)
    torch.testing.assert_close(got[:, 16:], tokenizer.decode(tokenizer.encode(filled))[:, :4])


def test_refinement_brings_the_pelvis_to_its_keyframes(data: Path) -> None:
    generator, clips = MSCoT(bundle()), load_motions(data, ("test",))[:1]
    found = controlled(generator, clips, 2, SolverSettings(iterations=15, natural=False))  # a random body has no bones
    free = controlled(generator, clips, 2, SolverSettings(iterations=0))
    assert found["average_error_m"] < free["average_error_m"] == free["guided_only_error_m"]
    assert found["skating_ratio_real"] == free["skating_ratio_real"] and found["seconds"] > 0
    assert 0 <= found["location_error"] <= 1


def test_the_spectrogram_puts_a_wobble_at_its_frequency() -> None:
    joints = torch.zeros(100, 22, 3)
    joints[:, 3, 0] = torch.sin(2 * math.pi * 5.0 * torch.arange(100) / 20)
    energy = spectrogram(joints)
    assert (energy.argmax(1) == 8).all()  # 5 Hz of 20 / 32 Hz a line
    assert energy.shape == (34, 17)


def test_the_plane_shows_scores_across() -> None:
    torch.manual_seed(0)
    codes, gradient = torch.randn(40, 6), torch.randn(6)
    flat = _plane(codes, codes @ gradient + 3)
    along = (codes @ gradient)[None] / gradient.norm()
    torch.testing.assert_close(flat[:, 0], (along - along.mean())[0], atol=1e-4, rtol=1e-3)
    centred = codes - codes.mean(0)
    assert (flat.norm(dim=1) <= centred.norm(dim=1) + 1e-4).all() and float(flat[:, 1].std()) > 0.5  # a projection


def test_pictures_of_scales_guidance_and_codes(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scenectl.bench.studies.figures._SECONDS", 2.0)
    generator, test = MSCoT(bundle()), prepare(data, ["test"], None, tmp_path, 0)
    draw_spectrogram(generator.bundle.tokenizer, test, tmp_path / "a.png")
    draw_code_use(generator.bundle.tokenizer, test, tmp_path / "b.png")
    guided = guided_scales(generator)
    assert len(guided.scales) == len(guided.expected) == generator.quantiser.scales
    for scale, post in zip(guided.scales, guided.posteriors, strict=True):
        torch.testing.assert_close(post.exp().sum(-1), torch.ones(post.shape[:2]))
        assert float((post * 1.0 - scale.prior).abs().max()) > 0
    draw_scales(guided, tmp_path / "c.png", tmp_path / "d.png")
    draw_tilt(guided, tmp_path / "e.png")
    rows = [{"refinement_iterations": n, **controlled(generator, load_motions(data, ("test",))[:1], 1,
             SolverSettings(iterations=n))} for n in (0, 3)]  # fmt: skip
    draw_trade_off(rows, tmp_path / "f.png")
    assert all((tmp_path / f"{name}.png").read_bytes().startswith(PNG) for name in "abcdef")


def test_the_command_names_the_ablations_it_knows(scenectl, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    said = scenectl("bench", "ablations", "-o", tmp_path, "--only", "densties")
    assert said.status == 2 and "did you mean 'densities'" in said.err
    assert ablations.REFINERS.keys() == {"4-layer MLP", "8-layer MLP", "2-layer transformer", "3-layer transformer"}


def toml(settings: Augmentation) -> str:
    return "".join(f"{name} = {json.dumps(value)}\n" for name, value in settings.model_dump().items())


@pytest.fixture
def small(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    """A tiny recipe's bench on tiny weights, with a second classifier that has learnt nothing."""
    monkeypatch.setenv("SCENECTL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("scenectl.bench.models.generator.PIECES", 1)
    monkeypatch.setattr("scenectl.evaluation.acts.PIECES", CROUCHED)
    monkeypatch.setattr(ablations, "EVERY", 50)
    kinds = sorted({*EDITS.values(), *(kind for kinds in load_asked().kinds.values() for kind in kinds)})
    second = KindClassifier(kinds, 8, 1)
    save_weights(second, tmp_path / ACTS, {"config": second.config})
    (tmp_path / "tiny.toml").write_text(TINY.replace("bend = 1\n", toml(CROUCHED)))
    bench = Bench(data, tmp_path / "out", str(tmp_path / "tiny.toml"), iterations=3, acts=tmp_path)
    bench.__dict__["generator"] = MSCoT(bundle())
    return bench


def test_each_group_of_made_clips_is_left_out_on_one_tokenizer(small: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ablations, "LEARNT", {name: LEARNT[name] for name in ("all", "without edited")})
    said: list[str] = []
    table, kept = ablations.data(small, lambda what, done: said.append(what))
    rows = json.loads(kept.read_text())["rows"]
    assert [row["learns from"] for row in rows] == said == ["all", "without edited"]
    assert rows[0]["hours"] > rows[1]["hours"] and rows[0]["clips"] > rows[1]["clips"] == 5
    assert all(tuple(row) == tuple(rows[0]) for row in rows)
    for row in rows:
        assert 0 <= row["sentences_in_order"] <= 1 and 0 <= row["label_recall"] <= 1 and row["skating_over_real"] > 0
        assert {f"acts_{name}{of}" for name in (*ACTS_OF, "other") for of in ("", "_real")} < set(row)
    assert table.read_text().count("\n| ") == 3


def test_what_was_stopped_goes_on(small: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ablations, "judged", lambda *_: {"label_recall": 1.0})
    monkeypatch.setattr(ablations, "LEARNT", {name: LEARNT[name] for name in ("all", "recorded only")})
    trained, train = list[Path](), ablations.train_transformer

    def killed(*settings: Any) -> Any:
        if len(trained) == 1:
            raise KeyboardInterrupt
        trained.append(settings[-1].folder)
        return train(*settings)

    monkeypatch.setattr(ablations, "train_transformer", killed)
    with pytest.raises(KeyboardInterrupt):
        ablations.data(small, lambda what, done: None)
    monkeypatch.setattr(ablations, "train_transformer", lambda *s: trained.append(s[-1].folder) or train(*s))
    ablations.data(small, lambda what, done: None)
    assert len(trained) == len(set(trained)) == 2  # each once, in a folder of its own


def test_without_a_second_classifier_nothing_is_trained(small: Bench, tmp_path: Path) -> None:
    (tmp_path / ACTS).unlink()
    with pytest.raises(UserError, match=ACTS):
        ablations.data(small, lambda what, done: None)
    assert not small.out.exists()


def test_nothing_is_made_of_humanml3d(tmp_path: Path) -> None:
    for name in HUMANML3D:
        (tmp_path / name).touch()
    with pytest.raises(UserError, match="HumanML3D, of which nothing is made"):
        ablations.data(Bench(tmp_path, tmp_path / "out"), lambda what, done: None)


def test_groups_of_made_clips_are_every_setting_that_is_no_copy() -> None:
    whole = Augmentation().model_dump()
    assert Augmentation().without(*GROUPS) == Augmentation.none(mirror=True, bend=2, repeat=1.0)
    for group, names in GROUPS.items():
        left = Augmentation().without(group).model_dump()
        assert {name for name in whole if left[name] != whole[name]} == set(names)
        assert not any(left[name] for name in names)
    copies = {"mirror", "bend", "repeat", "speed", "max_turn", "min_travel", "max_sideways"}
    assert {name for names in GROUPS.values() for name in names} == set(whole) - copies
    assert [set(groups) for groups in LEARNT.values()] == [set(), *({group} for group in GROUPS), set(GROUPS)]
