"""Belts of a compiled model, or of a batch: their speeds are set, and their contacts read."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.tracks.parts import TrackParts
from sim.tracks.presets import require_options, require_stable
from sim.tracks.readings import SENSED_WIDTH, Floats, Reading, read_contacts
from trackslip.errors import InvalidValueError, require


class _Map:
    """Where T tracks are in a compiled model."""

    def __init__(self, model: mujoco.MjModel, tracks: tuple[TrackParts, ...]) -> None:
        require(tracks, "tracks", tracks, "at least one")
        for each in tracks:
            require_stable(model.opt.timestep, each.preset)
        self.names = tuple(name for each in tracks for name in each.names)
        require(len(set(self.names)) == len(self.names), "tracks", self.names, "each bound once")
        try:
            bodies = [body for each in tracks for body in each.bodies]
            self.bodies = np.array([model.body(body).id for body in bodies])
            self.geoms = np.array([model.geom(geom).id for each in tracks for names in each.geoms for geom in names])
            sensors = [model.sensor(body).id for body in bodies]
        except KeyError:
            raise InvalidValueError("tracks", self.names, "in the model: compile the spec they were added to") from None
        require_options(model.opt)
        counts = [len(names) for each in tracks for names in each.geoms]
        self.track = np.repeat(np.arange(len(self.names)), counts)
        self.direction = np.array([way for each in tracks for _ in each.names for way in each.directions])
        address, slots = model.sensor_adr[sensors], model.sensor_dim[sensors] // SENSED_WIDTH
        self.groups = []  # tracks of equally many slots: which, and where theirs are (T', C, SENSED_WIDTH)
        for count in sorted(set(slots.tolist())):
            which = np.flatnonzero(slots == count)
            place = np.arange(count * SENSED_WIDTH).reshape(count, SENSED_WIDTH)
            self.groups.append((which, address[which, None, None] + place))

    def surface(self, speeds: Floats) -> Floats:
        """Surface velocities (..., G, 6) of the geoms for belt speeds (..., T)."""
        return speeds[..., self.track, None] * self.direction

    def read(self, sensordata: Floats, axes: Floats, speeds: Floats) -> Reading:
        """Reading from sensor data (..., S), the tracks' axes to the left (..., T, 3), and speeds (..., T)."""
        parts = []
        for which, place in self.groups:
            used = max(1, int(sensordata[..., place[:, 0, 0]].max()))  # the first slots are filled first
            parts.append(read_contacts(sensordata[..., place[:, :used]], axes[..., which, :], speeds[..., which]))
        order = np.argsort(np.concatenate([which for which, _ in self.groups]))
        columns = [np.concatenate([getattr(part, each.name) for part in parts], axis=-1) for each in fields(Reading)]
        return Reading(*(column[..., order] for column in columns))


class Belts:
    """The belts of T tracks in a compiled model."""

    names: tuple[str, ...]
    """Name of each track (T,)."""

    def __init__(self, model: mujoco.MjModel, tracks: tuple[TrackParts, ...]) -> None:
        """See `bind`."""
        self._map = _Map(model, tracks)
        self.names = self._map.names
        model.flg_surfacevel = 1  # compiled with belts at rest, the engine would ignore later speeds

    def set(self, model: mujoco.MjModel, speeds: ArrayLike) -> None:
        """Set the belts' speeds (T,) [m/s]; positive drives the robot forwards."""
        model.geom_surfacevel[self._map.geoms] = self._map.surface(_speeds(speeds, len(self.names)))

    def speeds(self, model: mujoco.MjModel) -> Floats:
        """Speeds (T,) of the belts [m/s]."""
        return _set_speeds(self._map, model.geom_surfacevel)

    def read(self, model: mujoco.MjModel, data: mujoco.MjData) -> Reading:
        """Forces and motion (T,) of the tracks in the last step, at the belts' speeds of now."""
        axes = data.xmat.reshape(-1, 3, 3)[self._map.bodies, :, 1]
        return self._map.read(data.sensordata, axes, self.speeds(model))

    def bind_batch(self, batch: Any) -> BatchBelts:
        """Return the belts of a `mujoco.batch.Batch` of the bound model."""
        return BatchBelts(self._map, batch)


class BatchBelts:
    """The belts of T tracks in each of N simulations of a batch."""

    names: tuple[str, ...]
    """Name of each track (T,)."""

    def __init__(self, where: _Map, batch: Any) -> None:
        """See `Belts.bind_batch`."""
        self._map, self.names = where, where.names
        self._surface: NDArray[np.float64] = batch.expand("geom_surfacevel")  # (N, ngeom, 6), live
        self._sensordata: NDArray[np.float64] = batch.bind("sensordata")  # (N, S), live
        self._xmat: NDArray[np.float64] = batch.bind("xmat")  # (N, nbody, 9), live

    def set(self, speeds: ArrayLike, rows: Any = slice(None)) -> None:
        """Set the belts' speeds (R, T) [m/s] of the simulations `rows`."""
        self._surface[np.arange(len(self._surface))[rows][:, None], self._map.geoms] = self._map.surface(
            _speeds(speeds, len(self.names))
        )

    def speeds(self) -> Floats:
        """Speeds (N, T) of the belts [m/s]."""
        return _set_speeds(self._map, self._surface)

    def read(self) -> Reading:
        """Forces and motion (N, T) of the tracks in the last step, at the belts' speeds of now."""
        axes = self._xmat[:, self._map.bodies].reshape(len(self._xmat), -1, 3, 3)[..., 1]
        return self._map.read(self._sensordata, axes, self.speeds())


def bind(model: mujoco.MjModel, *tracks: TrackParts) -> Belts:
    """Return the belts of all these tracks in a compiled model, in this order; each pair is (left, right).

    Raises InvalidValueError if the model lacks one of the tracks.
    """
    return Belts(model, tracks)


def _speeds(speeds: ArrayLike, count: int) -> Floats:
    values = np.asarray(speeds, float)
    fits = values.ndim > 0 and values.shape[-1] == count
    require(fits, "shape of speeds", values.shape, f"(..., {count}), a belt each")
    require(np.isfinite(values).all(), "speeds", values[~np.isfinite(values)][:1].tolist(), "finite")
    return values


def _set_speeds(where: _Map, surface: Floats) -> Floats:
    first = np.searchsorted(where.track, np.arange(len(where.names)))
    direction = where.direction[first]
    moved: Floats = (surface[..., where.geoms[first], :] * direction).sum(axis=-1)
    return moved / (direction**2).sum(axis=-1)
