"""A command's run: its results folder, progress, times and manifest, and the logs kept if driving
fails.
"""

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

from experiments.common.manifest import make_manifest
from experiments.common.plain_json import plain, write_json
from experiments.common.progress import SIMULATED, Advance, progress
from experiments.common.results import MANIFEST_FILE, SUMMARY_FILE, write_runs
from experiments.common.results_folder import results_folder
from sim.runs.stopwatch import Stopwatch
from trackslip.errors import RunFailedError, TrackslipError
from trackslip.logs.runlog import RunLog
from trackslip.replacement import DRAFT_FILE


class Run:
    """A command's run with the options `config`: a context manager, in whose block results are
    written to `folder`.

    The results are moved to `config.out` when the block ends, unless it fails. If driving fails in
    the block (RunFailedError), `config.out` gets the logs up to the failure and a manifest with the
    reason under "error", and TrackslipError is raised. Raises OutputError as `results_folder` does.
    """

    def __init__(self, config: Any, resumed: re.Pattern[str] = DRAFT_FILE) -> None:
        """`resumed`: names of the files of unfinished work that the command takes up."""
        self.config = config
        self.resumed = resumed
        self.command = type(config).__module__.split(".")[1]
        self.folder = Path(config.out)
        self.watch = Stopwatch()
        """Computing times of the command's stages."""
        self._began = time.perf_counter()
        self._context = self._in_folder()

    @property
    def wall(self) -> float:
        """Time since the run began [s]."""
        return time.perf_counter() - self._began

    def busy(self, stage: str) -> AbstractContextManager[Advance]:
        """Show during a block that a stage of unknown length is under way."""
        return progress(stage, None, "")

    def progress(
        self, stage: str, total: float, unit: str = SIMULATED, done: float = 0.0
    ) -> AbstractContextManager[Advance]:
        """Show a stage's progress during a block, which calls the yielded function with each amount
        done.
        """
        return progress(stage, total, unit, done)

    def manifest(self, **about: Any) -> dict[str, Any]:
        """Everything needed to reproduce the results: options, versions, git state, and `about`."""
        return make_manifest(self.command, self.config, self.wall, **about)

    def write(
        self,
        summary: Mapping[str, Any],
        logs: Sequence[RunLog] = (),
        simulated: float | None = None,
        manifest: Mapping[str, Any] | None = None,
        **about: Any,
    ) -> None:
        """Write the summary with the times, the manifest and, if there are any, logs.

        Args:
            summary: content of summary.json; the run's times are appended to those under "timing".
            logs: the runs to write to runs.parquet.
            simulated: simulated time, summed over all robots [s].
            manifest: the manifest, if one was made already, as for a report.
            about: further entries of the manifest.
        """
        timing: dict[str, Any] = {**summary.get("timing", {}), "wall_s": self.wall}
        if simulated is not None:
            timing["simulated_s"] = simulated
        timing["stages"] = dict(self.watch.stages) or {self.command: self.wall}
        if logs:
            write_runs(self.folder, logs)
        write_json(self.folder / SUMMARY_FILE, {**plain(summary), "timing": timing})
        write_json(
            self.folder / MANIFEST_FILE, self.manifest(**about) if manifest is None else manifest
        )

    def __enter__(self) -> "Run":
        return self._context.__enter__()

    def __exit__(self, *error: Any) -> bool | None:
        return self._context.__exit__(*error)

    @contextmanager
    def _in_folder(self) -> Iterator["Run"]:
        failure: RunFailedError | None = None
        folder = results_folder(self.folder, self.config.overwrite, self.resumed)
        with folder as self.folder:
            try:
                yield self
            except RunFailedError as error:
                if not error.logs:
                    raise
                failure = error
                write_runs(self.folder, error.logs)
                write_json(self.folder / MANIFEST_FILE, {**self.manifest(), "error": str(error)})
        if failure is not None:
            raise TrackslipError(
                f"{failure}; {self.config.out} contains the runs until then"
            ) from failure
