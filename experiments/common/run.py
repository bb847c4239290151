"""A command's run: its folder of results, progress, times and manifest, and what is kept of runs that fail."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

from experiments.common.manifest import make_manifest
from experiments.common.plain_json import plain, write_json
from experiments.common.progress import Advance, busy, progress
from experiments.common.results import MANIFEST_FILE, results_folder, write_results, write_runs
from sim.stopwatch import Stopwatch
from trackslip.errors import RunFailedError, TrackslipError
from trackslip.logs.runlog import RunLog


class Run:
    """A run of the command whose options are `config`, for the block that writes its results.

    `config.out` gets the results when the block ends, and nothing if it fails. No other command can write there
    meanwhile. Where driving fails in the block (RunFailedError), `out` gets the logs until then, and a manifest with
    the reason under "error"; the failure is raised as a TrackslipError.
    """

    def __init__(self, config: Any, then: Callable[[], None] = lambda: None) -> None:
        """`then` is called when the results are in place, before another command can write to the folder.

        Raises OutputError, when the block begins, if the folder can't be written or another command is writing there.
        """
        self.config = config
        self.command = type(config).__module__.split(".")[1]
        self.folder = Path(config.out)
        """Folder to write results to; its files replace those of `config.out` when the block ends."""
        self.watch = Stopwatch()
        """Times of the command's stages."""
        self._began = time.perf_counter()
        self._results = self._in_folder(then)

    @property
    def wall(self) -> float:
        """Time since the run began [s]."""
        return time.perf_counter() - self._began

    def busy(self, stage: str) -> AbstractContextManager[Advance]:
        """Show that a stage of unknown progress is under way, for a block."""
        return busy(stage)

    def progress(self, stage: str, total: float, unit: str = "s", done: float = 0.0) -> AbstractContextManager[Advance]:
        """Show the progress of a stage, for a block that calls what it gets with what has been done since."""
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
            summary: content of summary.json; its times, under "timing", come before those of the run.
            logs: what is written to runs.parquet.
            simulated: how long all robots drove together [s].
            manifest: the manifest if there is one already, as in a report.
            about: more entries of the manifest.
        """
        timing: dict[str, Any] = {**summary.get("timing", {}), "wall_s": self.wall}
        if simulated is not None:
            timing["simulated_s"] = simulated
        timing["stages"] = dict(self.watch.stages) or {self.command: self.wall}
        content = {**plain(summary), "timing": timing}
        write_results(self.folder, content, self.manifest(**about) if manifest is None else manifest, logs)

    def __enter__(self) -> "Run":
        return self._results.__enter__()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        return self._results.__exit__(kind, error, trace)

    @contextmanager
    def _in_folder(self, then: Callable[[], None]) -> Iterator["Run"]:
        failure: RunFailedError | None = None
        with results_folder(self.folder, then, None if self.config.overwrite else self.command) as folder:
            self.folder = folder
            try:
                yield self
            except RunFailedError as error:
                if not error.logs:
                    raise
                failure = error
                self._keep(error)
        if failure is not None:
            raise TrackslipError(f"{failure}; {self.config.out} contains the runs until then") from failure

    def _keep(self, failure: RunFailedError) -> None:
        """Write the logs until a failure, and the reason."""
        write_runs(self.folder, failure.logs)
        write_json(self.folder / MANIFEST_FILE, {**self.manifest(), "error": str(failure)})
