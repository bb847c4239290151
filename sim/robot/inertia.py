"""Mass, centre of mass and inertia of bodies that move as one, and those that no body can have."""

from __future__ import annotations

import warnings
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import RobotWarning
from trackslip.kinematics import Array


def composite(model: mujoco.MjModel, data: mujoco.MjData, bodies: ArrayLike) -> tuple[float, Array, Array]:
    """Mass [kg], centre (3,) [m] and inertia (3, 3) about it [kg m^2] of bodies where they are, in the world's axes."""
    own = np.asarray(bodies, int)
    mass = model.body_mass[own]
    centre = mass @ data.xipos[own] / mass.sum()
    turned, away = data.ximat[own].reshape(-1, 3, 3), data.xipos[own] - centre
    inertia = (turned * model.body_inertia[own, None]) @ turned.swapaxes(1, 2)
    square = (away**2).sum(axis=1)[:, None, None] * np.eye(3) - away[:, :, None] * away[:, None]
    return float(mass.sum()), centre, (inertia + mass[:, None, None] * square).sum(axis=0)


def warn_of_inertia(model: mujoco.MjModel, robot: int, path: Path) -> None:
    """Give a RobotWarning for an inertia whose radius of gyration is beyond all of the body's shapes.

    Links of the body `robot` that are fixed to each other are one body; bodies without shapes are measured by the whole
    robot's. The model comes from the file `path`.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    links = np.flatnonzero(model.body_rootid == robot)
    for body in np.unique(model.body_weldid[links]):
        own = links[model.body_weldid[links] == body]
        if not model.body_mass[own].sum():
            continue
        mass, centre, inertia = composite(model, data, own)
        shapes = np.isin(model.geom_bodyid, own)
        shapes = shapes if shapes.any() else np.isin(model.geom_bodyid, links)
        reach = (np.linalg.norm(data.geom_xpos[shapes] - centre, axis=1) + model.geom_rbound[shapes]).max(initial=0.0)
        gyration = float(np.sqrt(np.linalg.eigvalsh(inertia)[-1] / mass))
        if gyration > reach:
            worst = own[model.body_inertia[own].max(axis=1).argmax()]
            what = f"inertia of link {model.body(worst).name} = {model.body_inertia[worst].max():.3g} kg m^2"
            limit = (
                f"with it, {mass:.3g} kg have a radius of gyration of {gyration:.3g} m, and reach only {reach:.3g} m"
            )
            warnings.warn(f"{path}: {what}: {limit}", RobotWarning, stacklevel=3)
