"""MuJoCo alone in the motion of a simulation, to compare speeds with."""

from time import perf_counter

from mujoco import batch

from sim import Fleet
from trackslip.kinematics import Array


def bare_copy(source: batch.Batch) -> batch.Batch:
    """The same simulations in the same state, stepped by MuJoCo alone on as many threads."""
    copy = batch.Batch(source.model, source.nsim, nthread=source.nthread)
    for name in batch.MODEL_FIELDS:
        if source.expanded(name) is not None:
            copy.expand(name)[:] = source.expand(name)
    copy.state[:] = source.state
    return copy


class SameMotion:
    """The bare engine in the motion of a fleet: its belts change their speeds in every servo
    period, too.

    Belts at constant speeds would be cheaper physics: as long as nothing changes, the solver starts
    from its solution.
    """

    def __init__(self, fleet: Fleet) -> None:
        """Begin with the fleet's present state."""
        self._fleet = fleet
        self.bare = bare_copy(fleet.batch)
        self._start = self.bare.state.copy()
        self._drive = fleet.drive.of(range(fleet.size))
        self._speeds: list[Array] = []  # of the pads' surfaces (P, N, pads) [m/s]

    def note(self, duration: float) -> None:
        """Note what the fleet has done for the last `duration` [s] by its present set points."""
        robot = self._fleet.robot
        self._drive.command(self._fleet.drive.set_point)
        periods = round(duration / self._fleet.period)
        mean = self._drive.forecast(periods).mean  # (P, N, 2)
        of_tracks = -self._drive.radius * mean
        of_pads = of_tracks.take(robot.pad_side, axis=-1) * robot.pad_sign
        self._speeds.append(of_pads)
        self._drive = self._fleet.drive.of(range(self._fleet.size))

    def repeat(self) -> None:
        """Do all of it from the beginning."""
        surface = self.bare.expand("geom_surfacevel")[:, self._fleet.robot.pads, 2]  # live
        steps = round(self._fleet.period / self._fleet.robot.model.opt.timestep)
        self.bare.state[:] = self._start
        for noted in self._speeds:
            for speeds in noted:
                surface[:] = speeds
                self.bare.step(nstep=steps)


def seconds(act) -> float:
    began = perf_counter()
    act()
    return perf_counter() - began
