"""MuJoCo's own contact parameters, as if a robot had no recipe."""

import mujoco


def use_default_contact(model: mujoco.MjModel) -> None:
    """Replace the contact parameters of a model by MuJoCo's defaults, except the friction coefficients."""
    plain = mujoco.MjSpec().option
    model.pair_solref[:] = [0.02, 1.0]
    model.pair_solreffriction[:] = 0.0
    model.pair_solimp[:] = [0.9, 0.95, 0.001, 0.5, 2.0]
    model.pair_margin[model.pair_dim == 1] = -1.0  # the cores of tracks never touch
    for name in ("timestep", "cone", "impratio", "solver", "iterations"):
        setattr(model.opt, name, getattr(plain, name))
