"""Pictures and videos of a drive over a course."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import numpy as np
from matplotlib.image import imsave

from experiments.driving.course_run import CourseRun
from experiments.recording.video import FRAME_RATE, video
from sim.robot.tracked_model import TrackedModel
from sim.robot.tracked_view import TrackedView
from sim.terrain import Course

WIDTH, HEIGHT = 960, 540  # [px]
_CALM = 50  # rows before and after one, over which the height of the ground is averaged


def write_pictures(folder: Path, run: CourseRun, looks: TrackedModel, course: Course, count: int) -> None:
    """Write PNG files, named by their number and time, evenly over the run; `looks` is the model with its looks."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = np.unique(np.linspace(0, len(run.time) - 1, count + 1).astype(int)[1:])
    for number, (row, picture) in enumerate(zip(rows, _pictures(run, looks, course, rows), strict=True)):
        imsave(folder / f"{number:03d}_{run.time[row]:.1f}s.png", picture)


def write_video(
    file: Path, run: CourseRun, looks: TrackedModel, course: Course, advance: Callable[[float], None]
) -> None:
    """Write an .mp4 file in real time; `advance` is called with the simulated time of each picture [s]."""
    times = np.arange(max(1, round(run.time[-1] * FRAME_RATE))) / FRAME_RATE
    rows = np.clip(np.searchsorted(run.time, times), 0, len(run.time) - 1)
    with video(file, WIDTH, HEIGHT) as add:
        for picture in _pictures(run, looks, course, rows):
            add(picture)
            advance(1 / FRAME_RATE)


def _pictures(run: CourseRun, looks: TrackedModel, course: Course, rows: np.ndarray) -> Iterator[np.ndarray]:
    """The pictures (HEIGHT, WIDTH, 3) of rows (K,) of a run."""
    model, data = looks.model, mujoco.MjData(looks.model)
    view, travel = TrackedView(looks, WIDTH, HEIGHT), run.travel
    ground = course.height(*run.state.position[:, :2].T)
    # the camera follows the mean height around, so that it doesn't jump with every step of stairs
    calm = np.convolve(np.pad(ground, _CALM, mode="edge"), np.full(2 * _CALM + 1, 1 / (2 * _CALM + 1)), mode="valid")
    try:
        for row in rows:
            data.qpos[:] = run.qpos[row]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            yield view.picture(data, travel[row], float(calm[row]))
    finally:
        view.close()
