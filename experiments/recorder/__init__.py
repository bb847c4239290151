"""Recording of runs for the rerun viewer; rerun is imported only when a run is recorded."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from experiments.common.results import RECORDINGS_FOLDER, file_names
from trackslip.logs.runlog import RunLog


def record_all(
    folder: Path, logs: Sequence[RunLog], compared: Mapping[str, Sequence[RunLog]] | None = None
) -> None:
    """Record each run, and each group of runs in `compared`, to `folder`/RECORDINGS_FOLDER."""
    titles = [log.run for log in logs]
    groups: list[Sequence[RunLog]] = [[log] for log in logs]
    for name, group in (compared or {}).items():
        titles.append(name)
        groups.append(group)
    for file, group in zip(file_names(titles, ".rrd"), groups, strict=True):
        record(folder / RECORDINGS_FOLDER / file, group)


def record(file: Path, logs: Sequence[RunLog]) -> None:
    """Record a run, or several runs for comparison, in a .rrd file; raises OutputError if it can't
    be written.
    """
    from experiments.recorder.run import send_runs
    from experiments.recorder.stream import write_recording

    write_recording(file, title(logs), lambda recording: send_runs(recording, logs))


def title(logs: Sequence[RunLog]) -> str:
    """The title of a recording."""
    if len(logs) == 1:
        return logs[0].run
    names = ", ".join(log.run for log in logs)
    return f"{len(logs)} runs: {names}"
