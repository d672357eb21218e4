"""The page that says what a generator makes, from what `bench generator` measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scenectl.bench.models.criteria import HEADS, lines

_FIGURES = {
    # key of a row: (heading, factor, decimals)
    "skating_ratio": ("skating ratio", 1, 3),
    "max_acceleration_m_per_frame2": ("max. acceleration (m/frame²)", 1, 3),
    "acceleration_m_per_s2": ("mean acceleration (m/s²)", 1, 2),
    "quick_power_m2": ("power above 6 Hz (mm²)", 1e6, 2),
    "jerk_m_per_s3": ("jerk (m/s³)", 1, 0),
    "floating_share": ("floating (share of frames)", 1, 4),
    "floor_penetration_m": ("in the floor (mm)", 1000, 1),
    "bone_length_drift_m": ("bone length drift, largest (mm)", 1000, 0),
    "joint_limit_share": ("joint limits broken (share)", 1, 4),
    "self_penetration_m": ("self-penetration, deepest (mm)", 1000, 0),
}


def evaluation_page(result: Mapping[str, Any], weights: str, picture: Path | None = None) -> str:
    """Markdown of a result of `bench_generator`; `picture` is its confusion matrix, beside the page."""
    return "\n".join([
        f"# What the {weights} weights make, measured",
        "",
        "Everything on this page is printed by",
        "",
        "```",
        "scenectl bench generator --data MOTIONS --seeds 3 --against OTHER --json FILE --plot confusion.png "
        "--page evaluation.md",
        "```",
        "",
        *_criteria(result["criteria"]),
        *_sets(result),
        *_plausibility(result),
        *_kinds(result, picture),
        *(_tokens(result["summary"]) if "posterior" in result else []),
    ])  # fmt: skip


def _criteria(criteria: Sequence[Mapping[str, Any]]) -> list[str]:
    return ["## Wanted and got", "", *_table(list(HEADS), lines(criteria)), ""]


def _sets(result: Mapping[str, Any]) -> list[str]:
    tokens = (
        " *Reconstruction* is the test clip after a round trip through tokens, which is the best that these tokens "
        "could do; *random tokens* is what a generator makes that has learnt nothing."
    )
    return [
        "## Beside real motions",
        "",
        f"On the {result['clips']} captioned test clips of 36 frames or more, a motion each of the clip's length. The"
        f" evaluator is **{result['evaluator']}**, whose figures mean something beside one another, and nothing "
        f"beside published ones.{tokens if len(result['rows']) > 2 else ''}",
        "",
        *_table(
            ["set", "FID", "R@1", "R@2", "R@3", "distance to text", "diversity", "multimodality", "recall of kinds"],
            [_metrics(row) for row in result["rows"]],
        ),
        "",
        "R-precision in batches of 32. Means and 95 % intervals, FID of resampled sets:",
        "",
        *_table(["set", "FID", "R@3", "diversity"], [_intervals(row) for row in result["rows"]]),
        "",
    ]


def _plausibility(result: Mapping[str, Any]) -> list[str]:
    rows, summary = result["rows"], result["summary"]
    names = "skating", "acceleration", "max_acceleration", "power"
    skating, mean, most, power = (_times(summary[f"{name}_over_real"]) for name in names)
    return [
        "## Plausibility",
        "",
        *_table(
            ["set", *(heading for heading, _, _ in _FIGURES.values()), "believable"], [_plausible(row) for row in rows]
        ),
        "",
        f"Against real motions: skating {skating}, mean acceleration {mean} (of all joints and frames), maximum "
        f"acceleration {most} (the largest of each motion), power above 6 Hz {power} (of joints relative to the "
        "pelvis, Hann window). Believable: by the verdict on an empty floor, of captions that ask for no more.",
        "",
    ]


def _times(ratio: float | None) -> str:
    return "not measured" if ratio is None else f"{ratio:.2f} times"


def _kinds(result: Mapping[str, Any], picture: Path | None) -> list[str]:
    rows, summary = {row["set"]: row for row in result["rows"]}, result["summary"]
    ratio = summary["label_recall"] / summary["label_recall_real"]
    rebuilt = f", {rows['reconstruction']['label_recall']:.3f} on reconstructions" if "reconstruction" in rows else ""
    names = [name for name in ("real", "reconstruction", "generated") if name in rows]
    return [
        "## Kinds of motion",
        "",
        f"A classifier trained on real motions and then frozen: macro recall {summary['label_recall_real']:.3f} on "
        f"real test motions, {summary['label_recall']:.3f} on generated ones ({ratio:.0%}){rebuilt}. "
        f"Worst kind: {summary['worst_kind']}.",
        "",
        *_table(["kind", "clips", *names], _recalls(result["kinds"], names)),
        "",
        *([f"![confusion of kinds]({picture.name})", ""] if picture is not None else []),
        "Over real, kinds with fewer than ten test clips together:",
        "",
        *_table(["kind", "clips", "real", "generated", "ratio"], [_over_real(row) for row in result["recall"]]),
        "",
        *(_acts(result["recall_of_acts"]) if "recall_of_acts" in result else []),
    ]


def _acts(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    return [
        "## Acts",
        "",
        "A second classifier, which knows found and edited kinds too, on the same test clips and on pieces of held-out "
        "recordings; kinds that no recording shows are edits of test clips.",
        "",
        *_table(
            ["kind", "clips", "real", "generated", "ratio", "real ones are"],
            [[*_over_real(row), row["of"]] for row in rows],
        ),
        "",
    ]


def _over_real(row: Mapping[str, Any]) -> list[str]:
    shares = ("" if row[key] is None else f"{row[key]:.2f}" for key in ("real", "generated", "ratio"))
    return [row["kind"], str(row["clips"]), *shares]


def _tokens(summary: Mapping[str, Any]) -> list[str]:
    return [
        "## Reconstruction and tokens",
        "",
        f"- Test split, 64 frames, global joints: {_mm(summary['reconstruction_error_m'])} on Bandai, "
        f"{_mm(summary['reconstruction_error_other_m'])} on the other sources; root at the end "
        f"{_mm(summary['root_drift_m'])} and {_mm(summary['root_drift_other_m'])} (clips: see the model card).",
        f"- Codes used at scales beyond the third: {summary['code_use']:.0%} at the least.",
        "- First-order against exact token posterior, five pelvis keyframes, clipped alike: KL "
        f"{summary['posterior_kl']:.3f} nats a position.",
        "",
    ]


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *rows)]


def _mm(metres: float | None) -> str:
    return "no clip" if metres is None else f"{1000 * metres:.0f} mm"


def _metrics(row: Mapping[str, Any]) -> list[str]:
    keys = (
        "fid", "r_precision_top1", "r_precision_top2", "r_precision_top3", "multimodal_distance", "diversity",
        "multimodality", "label_recall",
    )  # fmt: skip
    return [row["set"], *("" if row[key] is None else f"{row[key]:.3f}" for key in keys)]


def _intervals(row: Mapping[str, Any]) -> list[str]:
    keys = ("fid_bootstrap", "r_precision_top3", "diversity")
    return [row["set"], *(f"{row[key]:.3f} ± {row[f'{key}_interval']:.3f}" for key in keys)]


def _plausible(row: Mapping[str, Any]) -> list[str]:
    believable = "" if row["believable"] is None else f"{row['believable']:.0%}"
    figures = (f"{factor * row[key]:.{places}f}" for key, (_, factor, places) in _FIGURES.items())
    return [row["set"], *figures, believable]


def _recalls(kinds: Mapping[str, Any], names: Sequence[str]) -> list[list[str]]:
    """A row for each kind with enough test clips."""
    real = kinds["real"]
    clips = dict(zip(real["kinds"], map(sum, real["confusion"]), strict=True))
    return [
        [kind, str(clips[kind]), *(f"{kinds[name]['recall'].get(kind, 0.0):.2f}" for name in names)]
        for kind in sorted(real["recall"])
    ]
