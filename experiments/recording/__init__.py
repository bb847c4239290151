"""Record runs for the rerun viewer. Importing this does not import rerun; recording does."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.storage.results import RECORDINGS_FOLDER, file_names
from trackslip.logs.runlog import RunLog

if TYPE_CHECKING:
    from experiments.course.run import DrivenCourse
    from sim.robot.tracked_model import TrackedModel


def record_all(folder: Path, logs: Sequence[RunLog], compared: Mapping[str, Sequence[RunLog]] | None = None) -> None:
    """Record each run, and each of the groups `compared`, into RECORDINGS_FOLDER in `folder`."""
    groups = [*((log.run, [log]) for log in logs), *(compared or {}).items()]
    for name, (_, group) in zip(file_names([name for name, _ in groups], ".rrd"), groups, strict=True):
        record(folder / RECORDINGS_FOLDER / name, group)


def record(file: Path, logs: Sequence[RunLog], laws: Path | None = None) -> None:
    """Record a run, or several for comparison, as a .rrd file, complete or not at all.

    Raises OutputError if it can't be written.
    """
    from experiments.recording.run import send_runs
    from experiments.recording.stream import write_recording

    write_recording(file, title(logs), lambda stream: send_runs(stream, logs, laws))


def record_course_drive(file: Path, run: "DrivenCourse", world: "TrackedModel", about: Mapping[str, Any]) -> None:
    """Record a drive over a course; `world` is the model with its looks. Raises OutputError as `record` does."""
    from experiments.recording.course_drive import send_course_drive
    from experiments.recording.stream import write_recording

    name = f"{world.robot.name}: {run.outcome}"
    write_recording(file, name, lambda stream: send_course_drive(stream, run, world, about))


def title(logs: Sequence[RunLog]) -> str:
    """The title of a recording."""
    return logs[0].run if len(logs) == 1 else f"{len(logs)} runs: {', '.join(log.run for log in logs)}"
