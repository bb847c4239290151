"""Pictures and videos of a drive over a course; videos are encoded by PyAV, which only they need."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import mujoco
import numpy as np
from matplotlib.image import imsave

from experiments.common.results import write_output
from experiments.drive.course import DrivenCourse
from sim.robot.tracked_model import TrackedModel
from sim.robot.tracked_view import TrackedView
from trackslip.errors import OutputError, TrackslipError, first_line

WIDTH, HEIGHT = 960, 540  # [px]
_CALM = 50  # rows before and after a picture, over which the height of the ground is averaged
FRAME_RATE = 25
"""Pictures per second of a video [Hz]."""


def require_video() -> None:
    """Raise TrackslipError if PyAV isn't installed."""
    if importlib.util.find_spec("av") is None:
        raise TrackslipError('a video needs PyAV: pip install -e ".[video]"; --pictures N needs nothing else')


def write_pictures(folder: Path, run: DrivenCourse, looks: TrackedModel, count: int) -> list[Path]:
    """Write PNG files, named by their number and time, evenly over the run; `looks` is the model with its looks."""
    if not count:
        return []
    folder.mkdir(parents=True, exist_ok=True)
    rows = np.unique(np.linspace(0, len(run.time) - 1, count + 1).astype(int)[1:])
    files = [folder / f"{number:03d}_{run.time[row]:.1f}s.png" for number, row in enumerate(rows)]
    for file, picture in zip(files, _pictures(run, looks, rows), strict=True):
        imsave(file, picture)
    return files


def write_video(file: Path, run: DrivenCourse, looks: TrackedModel, advance: Callable[[float], None]) -> None:
    """Write an .mp4 file in real time, complete or not at all; OutputError if it can't be written.

    `advance` is called with the simulated time of each picture [s].
    """
    import av

    times = np.arange(max(1, round(run.time[-1] * FRAME_RATE))) / FRAME_RATE
    rows = np.clip(np.searchsorted(run.time, times), 0, len(run.time) - 1)

    def write(draft: Path) -> None:
        try:
            with av.open(str(draft), "w", format="mp4") as container:
                stream = container.add_stream("libx264", rate=FRAME_RATE, options={"crf": "22", "preset": "veryfast"})
                stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
                stream.time_base = Fraction(1, FRAME_RATE)
                for picture in _pictures(run, looks, rows):
                    container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
                    advance(1 / FRAME_RATE)
                container.mux(stream.encode())
        except av.FFmpegError as error:
            raise OutputError(f"{file}: can't be written ({first_line(error)})") from error

    write_output(file, write)


def _pictures(run: DrivenCourse, looks: TrackedModel, rows: np.ndarray) -> Iterator[np.ndarray]:
    """The pictures (HEIGHT, WIDTH, 3) of rows (K,) of a run."""
    model, data = looks.model, mujoco.MjData(looks.model)
    view, travel = TrackedView(looks, WIDTH, HEIGHT), run.travel
    ground = run.course.height(*run.state.position[:, :2].T)
    # the camera follows the mean height around, so that it doesn't jump with every step of stairs
    calm = np.convolve(np.pad(ground, _CALM, mode="edge"), np.full(2 * _CALM + 1, 1 / (2 * _CALM + 1)), mode="valid")
    try:
        for row in rows:
            data.qpos[:] = run.state.qpos[row]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            yield view.picture(data, travel[row], float(calm[row]))
    finally:
        view.close()
