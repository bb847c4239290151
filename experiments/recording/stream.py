"""Send one run, or several side by side, to a rerun stream."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from experiments.recording import columns, field, robot, sensing
from experiments.recording.blueprint import begin_of_loop, blueprint
from experiments.recording.robot_mesh import looks, parameters_of
from experiments.recording.series import compared_series, panels, series_of
from experiments.recording.traces import Traces, traces_of
from experiments.report.colours import BLUE
from experiments.report.laws import LAWS, shown
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog

RUN = "run"  # entity of a single run; it contains one entity per run if there are several
_DISTINCT = (BLUE, "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#F0E442", "#B8B8B8", "#8C510A", "#6A3D9A")


def send(stream: rr.RecordingStream, logs: Sequence[RunLog], laws: Path | None = None) -> float:
    """Send a run, or several on one time line, laws as in `traces_of`; returns the start of the loop to play [s]."""
    runs = [traces_of(log, laws) for log in logs]
    within = _within(runs)
    field.send_field(stream, runs[0], looks(parameters_of(logs[0])), within)
    robot.send_camera(stream, runs)
    roots, sent = _send_run(stream, runs[0]) if len(runs) == 1 else _send_comparison(stream, runs)
    worst = max(runs, key=lambda traces: 0.0 if traces.distance is None else float(np.max(traces.distance)))
    duration = max(float(traces.time[-1]) for traces in runs)
    begin = begin_of_loop(worst.moment, duration)
    stream.send_blueprint(blueprint(roots, panels(runs), sent, within, begin, duration))
    return begin


def _send_run(stream: rr.RecordingStream, traces: Traces) -> tuple[list[str], list[str]]:
    """Send everything about one run; returns its root and the entities of its plots."""
    model = looks(parameters_of(traces.log))
    robot.send_robot(stream, RUN, traces, model)
    robot.send_contacts(stream, RUN, traces, model)
    robot.send_shear(stream, RUN, traces, model)
    robot.send_paths(stream, RUN, traces, BLUE, estimate=True)
    robot.send_reference(stream, "reference", traces)
    sensing.send_estimate(stream, RUN, traces, model)
    sensing.send_scans(stream, RUN, traces, field.scan_height(model))
    columns.send_properties(stream, RUN, {"name": traces.log.run, **traces.log.metadata})
    return [RUN], columns.send_series(stream, RUN, traces.time, series_of(traces))


def _send_comparison(stream: rr.RecordingStream, runs: Sequence[Traces]) -> tuple[list[str], list[str]]:
    """Send several runs, each in its own colour; returns their roots and the entities of their plots."""
    logs = [traces.log for traces in runs]
    roots, sent = [], []
    drawn: set[str] = set()
    names = telling_names([log.run for log in logs])
    for number, (traces, name, colour) in enumerate(zip(runs, names, run_colours(logs), strict=True)):
        metadata = traces.log.metadata
        roots.append(rr.new_entity_path([RUN, traces.log.run]).removeprefix("/"))
        robot.send_simple_robot(stream, roots[-1], traces, looks(parameters_of(traces.log)), colour)
        robot.send_paths(stream, roots[-1], traces, colour, estimate=False)
        series = compared_series(traces, name, colour, paler(colour))
        sent += columns.send_series(stream, roots[-1], traces.time, series)
        columns.send_properties(stream, f"{RUN}_{number}", {"name": traces.log.run, **metadata})
        path = str([metadata.get(key) for key in ("reference", "circle")])
        if path not in drawn:  # runs with the same reference share its picture
            robot.send_reference(stream, f"reference/{len(drawn)}", traces)
            drawn.add(path)
    return roots, sent


def telling_names(names: Sequence[str]) -> list[str]:
    """The runs' names without the words that all of them share."""
    words = [name.split() for name in names]
    if len({len(name) for name in words}) > 1:
        return list(names)
    differ = [len(set(column)) > 1 for column in zip(*words, strict=True)]
    return [" ".join(word for word, tells in zip(name, differ, strict=True) if tells) for name in words]


def run_colours(logs: Sequence[RunLog]) -> list[str]:
    """One colour per run: that of its compensation, if no two are the same."""
    names = [str(log.metadata.get("compensation")) for log in logs]
    if len(set(names)) == len(names) and set(names) <= set(LAWS):
        on_dark = {"published": "#e6e6e6"}
        return [on_dark.get(name, shown(name).colour) for name in names]
    return [_DISTINCT[k % len(_DISTINCT)] for k in range(len(logs))]


def paler(colour: str) -> str:
    """A colour halfway to white."""
    return "#" + "".join(f"{(int(colour[k : k + 2], 16) + 255) // 2:02x}" for k in (1, 3, 5))


def _within(runs: Sequence[Traces]) -> Array:
    """Points (n, 2) that enclose everything of interest."""
    points = [traces.pose[:, :2] for traces in runs]
    points += [traces.reference[:, :2] for traces in runs if traces.reference is not None]
    points += [mount[None, :2] for traces in runs if (mount := field.mount_of(traces)) is not None]
    return np.concatenate(points)
