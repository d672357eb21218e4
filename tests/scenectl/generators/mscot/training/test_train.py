"""Recipes, losses, and one whole tiny training: stages, resume, weights that generate, a model card."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
import torch
import torch.nn.functional as F

from scenectl.data.features import features_to_joints, joints_to_features
from scenectl.generators import load_generator
from scenectl.generators.mscot.bundle import build, bundled_weights, load_bundle
from scenectl.generators.mscot.networks.tokenizer import Tokenizer
from scenectl.generators.mscot.training.tokenizer import _kept_scales, reconstruction_error
from scenectl.generators.mscot.training.transformer import Captions, _corrupted
from scenectl.networks.text import TextFeatures
from scenectl.tasks.task import Task
from scenectl.training.command import train
from scenectl.training.dataset import prepare
from scenectl.training.losses import ReconstructionWeights, _amplitudes, reconstruction_loss
from scenectl.training.recipe import Recipe, load_recipe
from scenes.errors import UserError
from scenes.motion.motion import Pose2D
from tests.scenectl.small import Words, config, walk
from tests.scenectl.training.folder import same, walks

DECODER = """[decoder]
frames = [32, 24]
loop = { iterations = 4, batch = 4, warmup = 1, log_every = 2 }
"""
TINY = f"""
seed = 4
[model]
name = "tiny"
text = "none"
tokenizer = {{ width = 16, depth = 2, code_dim = 16, codes = 16, scales = [1, 2, 4], scale_convs = 2 }}
transformer = {{ width = 16, layers = 1, heads = 2, text_dim = 1 }}
refiner = {{ width = 16, layers = 1, heads = 2 }}
[augmentation]
bend = 1
[tokenizer]
frames = [32, 24]
continuous = 3
loop = {{ iterations = 8, batch = 4, learning_rate = 1e-3, warmup = 2, log_every = 2 }}
{DECODER}[refiner]
frames = [32]
loop = {{ iterations = 3, batch = 4, warmup = 1, log_every = 1 }}
[transformer]
min_frames = 36
max_frames = 48
loop = {{ iterations = 4, batch = 8, warmup = 1, log_every = 2 }}
"""


@pytest.fixture(scope="module")
def recipe(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recipe") / "tiny.toml"
    path.write_text(TINY)
    return path


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walks(tmp_path_factory.mktemp("data"))


@pytest.fixture(scope="module")
def run(recipe: Path, data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run."""
    return train("all", data, recipe, tmp_path_factory.mktemp("run") / "tiny")


def millions(module: torch.nn.Module) -> float:
    return sum(p.numel() for p in module.parameters()) / 1e6


def test_the_paper_recipe_has_the_papers_sizes() -> None:
    """Table 6: encoder and decoder 19.44 M, quantiser 6.30 M.

    Transformer (24.51 M there) and refiner (2.72 M) are smaller here: appendix B.2 gives layers, widths and heads
    but not their blocks, and plain ones with those numbers come to 15.3 M and 1.8 M.
    """
    recipe = load_recipe("paper")
    tokenizer, transformer, refiner = build(recipe.model)
    assert millions(tokenizer.encoder) + millions(tokenizer.decoder) == pytest.approx(19.44, rel=0.01)
    assert millions(tokenizer.quantiser.convs) == pytest.approx(6.30, rel=0.01)
    assert millions(transformer) == pytest.approx(15.34, rel=0.01)
    assert millions(refiner) == pytest.approx(1.84, rel=0.01)
    model = recipe.model
    assert (model.tokenizer.codes, model.tokenizer.code_dim, len(model.tokenizer.scales)) == (1024, 512, 10)
    assert (model.transformer.layers, model.transformer.width, model.transformer.heads) == (6, 384, 6)
    assert (model.refiner.layers, model.refiner.width) == (2, 256)
    assert (recipe.tokenizer.commitment, recipe.tokenizer.dropout, recipe.tokenizer.loop.batch) == (0.02, 0.2, 512)
    assert all(part.loop.learning_rate == 2e-4 for part in (recipe.tokenizer, recipe.transformer, recipe.refiner))
    assert (recipe.transformer.min_frames, recipe.transformer.max_frames) == (40, 196)


def test_the_compact_recipe_is_small() -> None:
    networks = build(load_recipe("compact").model)
    assert sum(map(millions, networks)) < 8


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("seed = 4", "seed ="), "not valid TOML"),
        (("seed = 4", "sede = 4"), "sede"),
        (("continuous = 3", "continuous = 'few'"), r"tokenizer\.continuous"),
        (("batch = 8, ", ""), r"transformer\.loop\.batch"),
        (("bend = 1", "bent = 1"), r"augmentation\.bent"),
    ],
)
def test_a_wrong_line_of_a_recipe_is_named(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    path = tmp_path / "r.toml"
    path.write_text(TINY.replace(*change))
    with pytest.raises(UserError, match=words) as error:
        load_recipe(path)
    assert "\n" not in str(error.value) and str(path) in str(error.value)


def test_unknown_recipes_name_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="did you mean 'compact'"):
        load_recipe("compcat")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UserError, match="not valid TOML"):
        load_recipe(tmp_path / "binary.toml")


def test_a_run_ends_in_weights_that_generate(run: Path) -> None:
    generator = load_generator("mscot", run / "weights")
    assert generator.licence.startswith("non-commercial")
    got = generator.generate("a person walks", 2.05, Pose2D((1.0, 0.0, 1.0), 0.5), samples=2)
    assert got.motion.joints.shape == (2, 41, 22, 3) and torch.isfinite(got.motion.joints).all()


def test_bundled_weights_are_known_by_name_to_tasks_and_generators(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("default", "permissive"):
        shutil.copytree(run / "weights", tmp_path / "weights" / name)
    (tmp_path / "weights" / "evaluator").mkdir()  # weights of something else
    monkeypatch.setattr("scenectl.generators.mscot.bundle._BUNDLED", tmp_path / "weights")
    assert bundled_weights() == ["default", "permissive"]
    assert load_generator("mscot", "permissive").licence.startswith("non-commercial")
    with pytest.raises(UserError, match="did you mean 'permissive'"):
        load_generator("mscot", "permisive")
    for name, wanted in (("permissive", "permissive"), ("own", str(tmp_path / "own"))):
        given = {"prompt": "walk", "seconds": 2.0, "generator": {"weights": name}, "folder": tmp_path}
        assert Task.model_validate(given).generator.weights == wanted


def test_a_run_leaves_a_card_and_figures(run: Path) -> None:
    weights = run / "weights"
    assert {p.name for p in weights.iterdir()} == {
        *(f"{part}.safetensors" for part in ("tokenizer", "transformer", "refiner", "metric")),
        "MODEL_CARD.md",
        "metrics.json",
        "curves.png",
    }
    card = (weights / "MODEL_CARD.md").read_text()
    for words in (
        "# Model card: tiny", "non-commercial", "NSF EIA-0196217", "CC BY-NC 4.0", "hours as recorded",
        "| walk | 0.0", "| tokenizer | 8 |", "| decoder | 4 |",
        "frames a second", "Codes restarted", "| left wrist |", "| 4 to 10 Hz |", "| scale | codes used, training |",
    ):  # fmt: skip
        assert words in card
    metrics = json.loads((weights / "metrics.json").read_text())
    assert metrics["reconstruction"]["64"]["all"]["clips"] == 2.0
    assert 0 < metrics["reconstruction"]["64"]["all"]["global_error_m"] < 10
    assert metrics["reconstruction"]["196"] == {}
    assert len(metrics["cross_entropy_by_scale"]) == 3 and all(0 < x < 10 for x in metrics["cross_entropy_by_scale"])
    assert [row["scale"] for row in metrics["code_use"]["test"]] == [1, 2, 3]
    assert (weights / "curves.png").read_bytes().startswith(b"\x89PNG")


def test_a_finished_run_is_not_trained_again(run: Path, recipe: Path, data: Path) -> None:
    before = {p.name: (run / p.name / "state.safetensors").read_bytes() for p in run.iterdir() if p.name in STAGES}
    assert set(before) == set(STAGES)
    train("all", data, recipe, run)
    assert all((run / name / "state.safetensors").read_bytes() == content for name, content in before.items())


STAGES = ("tokenizer", "decoder", "refiner", "transformer")


def weights_of(folder: Path) -> dict[str, torch.Tensor]:
    from safetensors.torch import load_file

    return load_file(folder / "state.safetensors")


class Killed(Exception):
    pass


def test_stages_that_are_killed_end_as_if_they_had_not_been(
    run: Path, recipe: Path, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from scenectl.training.loop import Loop

    own = Loop._step
    for stage, stops in (("tokenizer", (2, 5)), ("decoder", (2,)), ("refiner", (1,)), ("transformer", (3,))):
        for stop in stops:

            def step(loop: Loop, function: object, stop: int = stop) -> object:
                if loop.iteration == stop:
                    loop.save()
                    raise Killed
                return own(loop, function)  # type: ignore[arg-type]

            monkeypatch.setattr(Loop, "_step", step)
            torch.manual_seed(17 + stop)
            with pytest.raises(Killed):
                train(stage, data, recipe, tmp_path)  # type: ignore[arg-type]
        monkeypatch.setattr(Loop, "_step", own)
        train(stage, data, recipe, tmp_path)  # type: ignore[arg-type]
        assert same(weights_of(tmp_path / stage), weights_of(run / stage)), stage


def test_stages_need_those_before_them(recipe: Path, data: Path, tmp_path: Path) -> None:
    for stage in ("decoder", "refiner", "transformer", "export"):
        with pytest.raises(UserError, match="holds no trained tokenizer"):
            train(stage, data, recipe, tmp_path)  # type: ignore[arg-type]
    with pytest.raises(UserError, match="single stage"):
        train("all", data, recipe, tmp_path, iterations=3)
    with pytest.raises(UserError, match=r"no motions_20fps\.npz"):
        train("tokenizer", tmp_path, recipe, tmp_path)


def test_a_decoder_of_its_own_leaves_the_tokens_alone(run: Path, recipe: Path, data: Path, tmp_path: Path) -> None:
    trained, before = (weights_of(run / stage) for stage in ("decoder", "tokenizer"))
    got = load_bundle(run / "weights").tokenizer
    for name, tensor in got.state_dict().items():
        part, _, rest = name.partition(".")
        wanted = trained[f"averaged.{rest}"] if part == "decoder" else before[f"averaged.{name}"]
        torch.testing.assert_close(tensor, wanted, atol=1e-3, rtol=1e-2)
    moved = trained["averaged.net.0.weight"] - before["averaged.decoder.net.0.weight"]
    assert float(moved.abs().max()) > 0
    shutil.copytree(run / "tokenizer", tmp_path / "tokenizer")
    plain = tmp_path / "plain.toml"
    plain.write_text(TINY.replace(DECODER, ""))
    train("decoder", data, plain, tmp_path)  # a recipe without one has nothing to do
    assert not (tmp_path / "decoder").exists()
    with pytest.raises(UserError, match="holds no trained decoder"):
        train("refiner", data, recipe, tmp_path)


def test_a_text_encoder_that_does_not_fit_is_found_before_anything_is_trained(
    recipe: Path, data: Path, tmp_path: Path
) -> None:
    path = tmp_path / "r.toml"
    path.write_text(TINY.replace("text_dim = 1", "text_dim = 5"))
    with pytest.raises(UserError, match="text_dim"):
        train("all", data, path, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_iterations_can_be_given_for_one_stage(recipe: Path, data: Path, tmp_path: Path) -> None:
    train("tokenizer", data, recipe, tmp_path, iterations=4)
    curve = json.loads((tmp_path / "tokenizer" / "curve.json").read_text())
    assert [p["iteration"] for p in curve] == [2, 4] and all(p["loss"] > 0 for p in curve)


def test_the_reconstruction_loss_is_its_terms() -> None:
    wanted = joints_to_features(walk(40))[None].double()
    std = torch.rand(263, dtype=torch.float64) + 0.5
    got = wanted + 0.1 * torch.randn_like(wanted)
    difference = features_to_joints(got) - features_to_joints(wanted)
    smooth = F.smooth_l1_loss(got / std, wanted / std, reduction="none", beta=0.5)
    feet = difference[:, :, [7, 10, 8, 11]]
    terms = {
        "features": smooth.mean(),
        "root": smooth[..., 0].mean() + smooth[..., 1:3].mean(),
        "joints": difference.abs().mean(),
        "feet": (feet[:, 1:] - feet[:, :-1]).abs().mean(),
        "velocities": (difference[:, 1:] - difference[:, :-1]).abs().mean(),
        "lift": feet[..., 1].abs().mean(),
        "peaks": (difference[0, 2:] - 2 * difference[0, 1:-1] + difference[0, :-2]).norm(dim=-1).max(),
        "amplitudes": 2 / 16 * (spectra(got) - spectra(wanted)).abs().sum(-2).mean(),
        "contacts": sliding(features_to_joints(got)[:, :, [7, 10, 8, 11]], wanted[..., 259:263] > 0.5),
    }
    silent = dict.fromkeys(terms, 0.0)
    for name, value in terms.items():
        loss, error = reconstruction_loss(got, wanted, std, ReconstructionWeights(**{**silent, name: 3.0}))
        torch.testing.assert_close(loss, 3 * value)
        torch.testing.assert_close(error, difference.norm(dim=-1).mean())
    perfect, error = reconstruction_loss(wanted, wanted, std, ReconstructionWeights())
    assert float(perfect) == 0.0 and float(error) == 0.0


def spectra(features: torch.Tensor) -> torch.Tensor:
    """Moduli, never quite zero, of all coordinates' Fourier components about the pelvis, window by window."""
    joints = features_to_joints(features)
    tracks = (joints - joints[:, :, :1])[0].flatten(1)
    window = torch.hann_window(32, dtype=tracks.dtype)[:, None]
    pieces = [torch.fft.rfft(tracks[t : t + 32] * window, dim=0)[1:] for t in range(0, len(tracks) - 31, 8)]
    return (torch.stack(pieces).abs().square() + 1e-8).sqrt()


def test_amplitudes_care_for_how_much_a_joint_moves_and_not_for_when() -> None:
    """A wave half a period late costs nothing; one that is averaged away costs its amplitude."""
    time = torch.arange(64, dtype=torch.float64)
    wave = 0.1 * torch.sin(2 * torch.pi * time / 8)
    still = torch.zeros(1, 64, 22, 3, dtype=torch.float64)
    waving, late = still.clone(), still.clone()
    waving[0, :, 21, 0], late[0, :, 21, 0] = wave, -wave
    assert float((_amplitudes(waving) - _amplitudes(late)).abs().max()) < 1e-12
    assert float((_amplitudes(waving) - _amplitudes(still)).amax()) == pytest.approx(0.1, abs=2e-4)
    (gradient,) = torch.autograd.grad(_amplitudes(still.requires_grad_(True)).sum(), still)
    assert bool(gradient.isfinite().all())


def sliding(feet: torch.Tensor, stands: torch.Tensor) -> torch.Tensor:
    """Mean displacement along an axis over the frames at which the true foot stands, one by one."""
    steps = [
        (feet[0, t + 1, j] - feet[0, t, j]).abs().mean()
        for t in range(feet.shape[1] - 1)
        for j in range(4)
        if stands[0, t, j]
    ]
    assert len(steps) > 20
    return torch.stack(steps).mean()


def test_dropout_keeps_at_least_one_scale_and_mostly_all() -> None:
    model = Tokenizer(config().tokenizer)
    kept = _kept_scales(model, 5000, 0.2, torch.Generator().manual_seed(0))
    assert set(kept.tolist()) == {1, 2, 3, 4}
    assert float((kept == 4).float().mean()) == pytest.approx(0.8, abs=0.02)
    assert (_kept_scales(model, 50, 0.0, torch.Generator()) == 4).all()


def test_corruption_replaces_about_the_share_it_is_told() -> None:
    tokens = torch.full((100, 100), 3)
    changed = (_corrupted(tokens, 0.3, 16, torch.Generator().manual_seed(0)) != 3).float().mean()
    assert float(changed) == pytest.approx(0.3 * 15 / 16, abs=0.02)
    assert torch.equal(_corrupted(tokens, 0.0, 16, torch.Generator()), tokens)


def test_captions_are_the_clips_own_and_all_get_their_turn(data: Path, tmp_path: Path) -> None:
    windows = prepare(data, ["train"], None, tmp_path, 0)
    windows.captions[1][:] = ["one", "two words"]
    captions = Captions(windows, Words())
    seen = set()
    for seed in range(12):
        got = captions.draw(torch.tensor([1, 0]), torch.Generator().manual_seed(seed))
        assert isinstance(got, TextFeatures) and got.words.shape[1] == int(got.mask.sum(-1).max())
        texts = {i: Words().encode([text]) for i, text in enumerate(windows.captions[1])}
        (chosen,) = (i for i, t in texts.items() if torch.allclose(got.sentence[0], t.sentence[0]))
        seen.add(chosen)
        length = int(got.mask[0].sum())
        torch.testing.assert_close(got.words[0, :length], texts[chosen].words[0])
        torch.testing.assert_close(got.sentence[1], Words().encode(windows.captions[0]).sentence[0])
    assert seen == {0, 1}


def test_reconstruction_errors_are_what_they_are_called(data: Path, tmp_path: Path) -> None:
    windows = prepare(data, ["train"], None, tmp_path, 0)

    class Shifted(Tokenizer):
        """Raises every clip by 10 cm, and makes nothing else wrong."""

        def encode(self, features: torch.Tensor) -> list[torch.Tensor]:
            self.kept = features
            return [torch.zeros(1, 1, dtype=torch.long)]

        def decode(self, tokens: list[torch.Tensor]) -> torch.Tensor:
            moved = self.kept.clone()
            moved[..., 3] += 0.1
            moved[..., 5:67:3] += 0.1
            return moved

    got = reconstruction_error(Shifted(config().tokenizer), windows, 52)
    assert (
        got["all"]["clips"] == 4 and got["bandai"]["clips"] == 2 and got["other"]["clips"] == got["cmu"]["clips"] == 2
    )
    for row in got.values():
        assert row["global_error_m"] == pytest.approx(0.1, abs=1e-5)
        assert row["local_error_m"] == pytest.approx(0.0, abs=1e-5)
        assert row["root_drift_m"] == pytest.approx(0.1, abs=1e-5)


def test_the_permissive_recipe_is_compact_on_free_data() -> None:
    ours, compact = load_recipe("permissive").model_dump(), load_recipe("compact").model_dump()
    assert (ours["commercial_only"], ours["model"]["name"]) == (True, "permissive")
    ours["commercial_only"], ours["model"]["name"] = False, "compact"
    for stage in ("tokenizer", "decoder", "refiner", "transformer"):
        own, whole = ours[stage].pop("loop"), compact[stage].pop("loop")
        assert own["iterations"] < whole["iterations"] and own["batch"] == whole["batch"]
    assert ours == compact


def test_a_recipe_extends_another_key_by_key(recipe: Path, tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text(TINY)
    path = tmp_path / "own.toml"
    path.write_text('extends = "base.toml"\n[model]\nname = "own"\n[tokenizer]\nframes = [24]\n')
    got, base = load_recipe(path), load_recipe(recipe)
    assert got == base.varied({"model.name": "own", "tokenizer.frames": [24]})
    assert got.tokenizer.loop == base.tokenizer.loop and got.tokenizer.frames == (24,)
    for text, words in (("'own.toml'", "extends itself"), ("'bse'", "no training config 'bse'"), ("3", "one config")):
        path.write_text(f"extends = {text}")
        with pytest.raises(UserError, match=words):
            load_recipe(path)


def test_variants_of_unknown_keys_name_the_nearest(recipe: Path) -> None:
    made = load_recipe(recipe)
    with pytest.raises(UserError, match=r"did you mean 'model\.tokenizer\.codes'"):
        made.varied({"model.tokenizer.code": 8})
    with pytest.raises(UserError, match=r"tokenizer\.dropout"):
        made.varied({"tokenizer.dropout": "much"})
    assert made.varied({"tokenizer.reconstruction.contacts": 3}).tokenizer.reconstruction.contacts == 3.0


def test_recipes_hold_everything_they_are_made_of(recipe: Path) -> None:
    made = load_recipe(recipe)
    assert Recipe.model_validate(made.model_dump()) == made
