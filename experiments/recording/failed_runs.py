"""Results of commands whose runs may fail: what was driven until then is kept, so that it can be inspected."""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

from experiments.driving.world import World
from experiments.recording import record_all
from experiments.storage.plain_json import write_json
from experiments.storage.results import MANIFEST_FILE, results_folder, write_runs
from trackslip.errors import RunFailedError, TrackslipError


@contextlib.contextmanager
def results_or_failed_runs(out: Path, command: str, world: World) -> Iterator[Path]:
    """Like `results_folder`; if a run fails in the block, `out` gets its log, a recording if asked for, and a manifest.

    The manifest then gives the reason under "error", and the failure is raised as a TrackslipError.
    """
    began = time.perf_counter()
    failure: RunFailedError | None = None
    with results_folder(out) as folder:
        try:
            yield folder
        except RunFailedError as error:
            if not error.logs:
                raise
            failure = error
            write_runs(folder, error.logs)
            if world.config.rrd:
                record_all(folder, error.logs)
            manifest = world.manifest(command, time.perf_counter() - began)
            write_json(folder / MANIFEST_FILE, manifest | {"error": str(error)})
    if failure is not None:
        raise TrackslipError(f"{failure}; {out} contains the runs until then") from failure
