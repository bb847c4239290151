"""Pictures of a drive over a course."""

from functools import partial
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from matplotlib.image import imsave

from experiments.drive.course import DrivenCourse
from sim.engine.opengl import Pictures, place
from sim.robot.looks import RobotLooks
from sim.robot.tracked_model import TrackedModel

_SIZE: Final = 960, 540  # width and height [px]


def write_pictures(folder: Path, run: DrivenCourse, looks: TrackedModel, count: int) -> list[Path]:
    """Write `count` PNG files, spread evenly over the run, named by number and time; `looks` is the
    model to draw.
    """
    rows = np.unique(np.linspace(0, len(run.time) - 1, count + 1).astype(int)[1:])
    files = [folder / f"{number:03d}_{run.time[row]:.1f}s.png" for number, row in enumerate(rows)]
    if not files:
        return []
    data = mujoco.MjData(looks.model)
    view = RobotLooks.of(looks)
    pictures = Pictures(looks.model, *_SIZE)
    folder.mkdir(parents=True, exist_ok=True)
    climbed = run.state.position[:, 2] - run.state.position[0, 2]
    for file, row in zip(files, rows, strict=True):
        place(data, run.state.qpos[row])
        draw = partial(view.draw, data=data, travel=run.travel[row])
        imsave(file, pictures.take(data, view.camera(data, float(climbed[row])), draw))
    pictures.close()
    return files
