"""Recording of runs for the rerun viewer; rerun is imported only when a run is recorded."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from experiments.common.results import RECORDINGS_FOLDER, file_names
from trackslip.logs.runlog import RunLog


def record_all(
    folder: Path, logs: Sequence[RunLog], compared: Mapping[str, Sequence[RunLog]] | None = None
) -> None:
    """Record each run, and each group of runs in `compared`, to `folder`/RECORDINGS_FOLDER."""
    groups = [*((log.run, [log]) for log in logs), *(compared or {}).items()]
    for name, (_, group) in zip(
        file_names([name for name, _ in groups], ".rrd"), groups, strict=True
    ):
        record(folder / RECORDINGS_FOLDER / name, group)


def record(file: Path, logs: Sequence[RunLog]) -> None:
    """Record a run, or several runs for comparison, in a .rrd file; raises OutputError if it can't
    be written.
    """
    from experiments.recorder.run import send_runs
    from experiments.recorder.stream import write_recording

    write_recording(file, title(logs), lambda recording: send_runs(recording, logs))


def title(logs: Sequence[RunLog]) -> str:
    """The title of a recording."""
    return (
        logs[0].run if len(logs) == 1 else f"{len(logs)} runs: {', '.join(log.run for log in logs)}"
    )
