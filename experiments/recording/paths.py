"""Paths on the ground: driven, measured, and desired."""

from __future__ import annotations

import numpy as np
import rerun as rr

from experiments.recording.columns import at_height, rgb, send_poses
from experiments.recording.sensing import ESTIMATE_COLOUR
from experiments.recording.traces import Traces
from experiments.report.colours import BLUE

TRUE_COLOUR, REFERENCE_COLOUR = BLUE, "#b8b8b8"
_ABOVE = 0.004  # height of lines above the ground, and above each other [m]


def send_paths(stream: rr.RecordingStream, entity: str, traces: Traces, colour: str, estimate: bool) -> None:
    """Send the true path and the measured one."""
    known = traces.estimate[np.isfinite(traces.estimate).all(axis=1)]
    lines = [("true", traces.pose, colour, 0.008)] if traces.log.truth is not None else []
    if estimate or traces.log.truth is None:
        lines.append(("estimated", known, ESTIMATE_COLOUR if traces.log.truth is not None else colour, 0.004))
    for k, (name, pose, line_colour, radius) in enumerate(lines):
        if len(pose):
            points = at_height(pose, (k + 2) * _ABOVE)
            strip = rr.LineStrips3D([points], colors=[rgb(line_colour)], radii=[radius])
            stream.log(f"{entity}/path/{name}", strip, static=True)


def send_reference(stream: rr.RecordingStream, entity: str, traces: Traces) -> None:
    """Send the reference of the run, and the place on it where the robot should be."""
    if traces.reference is None:
        return
    points = at_height(traces.reference, _ABOVE)
    strip = rr.LineStrips3D([points], colors=[rgb(REFERENCE_COLOUR)], radii=[0.016])
    stream.log(f"{entity}/path", strip, static=True)
    target = rr.Arrows3D(vectors=[[0.25, 0, 0]], origins=[[0, 0, 0.02]], colors=[(255, 255, 255)], radii=[0.012])
    stream.log(f"{entity}/target", target, static=True)
    send_poses(stream, f"{entity}/target", traces.time, traces.reference, _ABOVE)
