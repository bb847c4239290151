"""What is finished of a benchmark, kept beside its results until it is complete: a stopped one goes on from there.

A part is a group of runs, stored under a hash of all that its numbers depend on. So a part is never taken for another,
and two processes that make the same one write the same.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow
import pyarrow.parquet

from experiments.benchmark.setup import Setup
from experiments.driving.lookup import policy_path, user_modules
from experiments.options.benchmark import BenchmarkConfig, Case
from experiments.storage.manifest import content, digest, made_by
from experiments.storage.plain_json import plain, write_json
from experiments.storage.results import SUMMARY_FILE
from trackslip.controllers.named import CONTROLLERS
from trackslip.logs import logfile
from trackslip.logs.runlog import RunLog
from trackslip.slip.law_file import SHIPPED

_FOLDER = ".benchmark-parts"
_IRRELEVANT = (
    "suite",
    "controllers",
    "compensations",
    "references",
    "grounds",
    "starts",
    "seeds",
    "jobs",
    "out",
    "pdf",
    "rrd",
)


@dataclass(frozen=True)
class Parts:
    """The parts in a folder of results."""

    folder: Path
    version: str
    """Hash of the code, with which the names of all its parts begin."""
    common: str
    """Hash of what else all parts depend on."""

    @classmethod
    def of(cls, setup: Setup) -> Parts:
        """Those of a benchmark, wherever it was stopped."""
        return cls(setup.config.out / _FOLDER, digest(made_by())[:8], digest(_common(setup)))

    def path(self, cases: Sequence[Case]) -> Path:
        """Where the part with these cases is, or will be."""
        own = any(case.controller not in CONTROLLERS for case in cases)
        files = {name for case in cases for name in (case.reference, case.ground)} | set(user_modules() if own else ())
        files |= {str(policy) for case in cases if (policy := policy_path(case.controller)) is not None}
        own_files = {name: content(Path(name)) for name in sorted(files) if Path(name).is_file()}
        return self.folder / f"{self.version}-{digest([self.common, [vars(case) for case in cases], own_files])}.json"

    @staticmethod
    def write(path: Path, rows: Sequence[dict[str, Any]], logs: Sequence[RunLog]) -> None:
        """Keep a part: its runs first, its rows last, each whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        runs = {"names": [log.run for log in logs], "bytes": 0}
        if logs:
            draft = path.with_suffix(f".runs-{os.getpid()}")
            logfile.write_parquet(logs, draft)
            runs["bytes"] = draft.stat().st_size
            os.replace(draft, runs_of(path))
        draft = path.with_suffix(f".rows-{os.getpid()}")
        write_json(draft, {"rows": rows, "runs": runs})
        os.replace(draft, path)

    def discard_useless(self) -> None:
        """Delete other code's parts and drafts that were left half-written; nobody else may be writing parts."""
        with contextlib.suppress(OSError):
            for file in self.folder.glob("*"):
                if not file.name.startswith(f"{self.version}-") or file.suffix not in (".json", ".parquet"):
                    file.unlink()
            self.folder.rmdir()

    def discard(self, paths: Sequence[Path]) -> None:
        """Delete parts, what they hold being now among the results, and their drafts; others' are left."""
        with contextlib.suppress(OSError):
            for path in paths:
                for file in self.folder.glob(f"{path.stem}.*"):
                    file.unlink()
            self.folder.rmdir()


def complete(path: Path) -> bool:
    """Whether a part is there, whole."""
    try:
        runs = json.loads(path.read_text(encoding="utf-8"))["runs"]
        if not runs["names"]:
            return True
        stored = logfile.read_table(runs_of(path)).column("run").unique().to_pylist()  # all of it, to check it
        return bool(runs_of(path).stat().st_size == runs["bytes"] and sorted(stored) == sorted(runs["names"]))
    except (OSError, ValueError, RecursionError, KeyError, TypeError, pyarrow.ArrowException):
        return False


def rows_of(path: Path) -> list[dict[str, Any]]:
    """The rows of a part."""
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["rows"]
    return rows


def names_of(path: Path) -> list[str]:
    """The names of a part's runs, those that were driven to the end."""
    names: list[str] = json.loads(path.read_text(encoding="utf-8"))["runs"]["names"]
    return names


def runs_of(path: Path) -> Path:
    """Where a part's runs are, if it has any."""
    return path.with_suffix(".parquet")


def _common(setup: Setup) -> dict[str, Any]:
    config: BenchmarkConfig = setup.config
    options = {name: value for name, value in plain(config).items() if name not in _IRRELEVANT}
    laws = config.laws or SHIPPED
    return options | {
        "model": setup.world.robot.digest,
        "world": plain([setup.world.parameters, setup.world.obstacles, setup.world.radius_error]),
        "laws": content(laws / SUMMARY_FILE if laws.is_dir() else laws),
    }
