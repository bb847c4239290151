"""Rows of the suite fair with the scores of all their runs, for others to drive again."""

from collections.abc import Mapping, Sequence
from typing import Any

from experiments.benchmark.gains import Gains
from experiments.benchmark.rows import score
from experiments.common.plain_json import plain
from experiments.common.sweep import Row

_SHOWN = ("rank", "success", "score", "rms_position_arc", "rms_heading", "roughness", "effort")


def submission(runs: Sequence[Row], entries: Sequence[Row], gains: Gains, about: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of a benchmark, each with its controller's arguments and the score of every run [m].

    They are driven again with `trackslip benchmark --gains default --controllers SPECIFICATION`, and the suite,
    compensation, reference and seed of a run.
    """
    scores: dict[tuple[str, str], dict[str, dict[str, float]]] = {}
    for run in runs:
        of = run["controller"], run["compensation"]
        scores.setdefault(of, {}).setdefault(run["reference"], {})[str(run["seed"])] = score(run)
    rows = [
        {"specification": gains.specification(*of), "compensation": of[1]}
        | {name: entry[name] for name in _SHOWN}
        | {"runs": scores[of]}
        for entry in entries
        for of in [(entry["controller"], entry["compensation"])]
    ]
    found: dict[str, Any] = plain({"suite": about["config"]["suite"], "git": about["git"], "rows": rows})
    return found | {"versions": about["versions"]}
