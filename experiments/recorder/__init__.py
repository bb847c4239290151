"""Record runs for the rerun viewer. Importing this does not import rerun; recording does."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from experiments.common.results import RECORDINGS_FOLDER, file_names
from trackslip.logs.runlog import RunLog


def record_all(folder: Path, logs: Sequence[RunLog], compared: Mapping[str, Sequence[RunLog]] | None = None) -> None:
    """Record each run, and each of the groups `compared`, into RECORDINGS_FOLDER in `folder`."""
    groups = [*((log.run, [log]) for log in logs), *(compared or {}).items()]
    for name, (_, group) in zip(file_names([name for name, _ in groups], ".rrd"), groups, strict=True):
        record(folder / RECORDINGS_FOLDER / name, group)


def record(file: Path, logs: Sequence[RunLog]) -> None:
    """Record a run, or several for comparison, as a .rrd file; raises OutputError if it can't be written."""
    from experiments.recorder.run import send_runs
    from experiments.recorder.stream import write_recording

    write_recording(file, title(logs), lambda recording: send_runs(recording, logs))


def title(logs: Sequence[RunLog]) -> str:
    """The title of a recording."""
    return logs[0].run if len(logs) == 1 else f"{len(logs)} runs: {', '.join(log.run for log in logs)}"
