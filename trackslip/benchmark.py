"""The results of `trackslip benchmark`, read from its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trackslip.arguments import checks_arguments
from trackslip.errors import LogError, counted
from trackslip.files import read_json
from trackslip.viewable import Viewable


@dataclass(frozen=True, repr=False)
class BenchmarkResults(Viewable):
    """Controllers and slip compensations compared by `trackslip benchmark`."""

    entries: tuple[Mapping[str, Any], ...]
    """The leaderboard, the best entry first. `score` is the mean rms position error from 12 s on
    [m], with 0.5 m for a run that lost the path; docs/benchmark.md lists the other columns.
    """
    runs: tuple[Mapping[str, Any], ...]
    """All runs, with controller, compensation, reference, ground, start, seed and errors."""

    @property
    def best(self) -> Mapping[str, Any]:
        """The first entry of the leaderboard."""
        return self.entries[0]

    def __repr__(self) -> str:
        best = self.best
        way = f"{best['controller']}, compensation {best['compensation']}"
        error = f"{1e3 * best['score']:.1f} mm rms"
        return f"<BenchmarkResults: {counted(len(self.runs), 'run')}, best: {way}, {error}>"


@checks_arguments
def load_benchmark(folder: str | Path) -> BenchmarkResults:
    """Read the results of `trackslip benchmark` from its folder, such as "out/benchmark".

    Raises:
        LogError: if the folder holds no results of a benchmark.
    """
    file = Path(folder) / "summary.json"
    content = read_json(file)
    entries = content.get("board") if isinstance(content, Mapping) else None
    if not entries:
        raise LogError(f"{file}: isn't the summary of `trackslip benchmark`")
    return BenchmarkResults(tuple(entries), tuple(content["cases"]))
