"""Ruts in soft soil: paving stones that tracks have driven over are meshes, which sink in as the
tracks pass.

The depth of a place is that of the deepest track that has covered it so far, by the log's sinkages.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from experiments.common.traces import Traces
from experiments.recorder.model import MAX_STONES, STONE, TONES
from experiments.recorder.stream import FIELD, Recording
from sim.robot.parameters import RobotParameters
from trackslip import se2
from trackslip.kinematics import Array

RUTS: Final = f"{FIELD}/ruts"
"""Entity above the stones with ruts."""
_CELLS: Final = 25  # along the side of a stone
_CELL: Final = STONE / _CELLS  # [m]
_FRAME: Final = 0.5  # time between the states of a stone [s]
_CHANGE: Final = 1e-4  # least deepening that is shown [m]
_DARKEST: Final = 0.35  # share of a stone's colour at the bottom of the deepest rut [-]
_Ints = NDArray[np.int_]


@dataclass(frozen=True)
class Ruts:
    """The stones with ruts, by their column and row, each with its states in order of time."""

    time: dict[tuple[int, int], list[float]]
    """Times of the states [s]."""
    depth: dict[tuple[int, int], list[Array]]
    """Depths (_CELLS + 1, _CELLS + 1) of the corners of its cells, by x and y [m]."""

    @property
    def stones(self) -> list[tuple[int, int]]:
        """Columns and rows of the stones."""
        return list(self.time)

    @property
    def deepest(self) -> float:
        """Depth of the deepest rut [m]."""
        return max(float(states[-1].max()) for states in self.depth.values())


def sinkage_of(traces: Traces) -> Array | None:
    """Depths (T, 2) of the ruts under the tracks of a run [m]; None on firm ground."""
    truth = traces.log.truth
    return None if truth is None else truth.sinkage


def ruts_of(runs: Sequence[tuple[Traces, RobotParameters]]) -> Ruts:
    """The ruts of several robots in the same soil."""
    end = max(float(traces.time[-1]) for traces, _ in runs)
    presses = [_presses(traces, robot) for traces, robot in runs if sinkage_of(traces) is not None]
    ruts = Ruts({}, {})
    if not presses:
        return ruts
    frame = np.concatenate([each[0] for each in presses])
    corner = np.concatenate([each[1] for each in presses])
    depth = np.concatenate([each[2] for each in presses])

    # depths of all corners in the rectangle around the ruts, in whole stones
    first = corner.min(axis=0) // _CELLS - 1
    count = np.minimum(corner.max(axis=0) // _CELLS + 2 - first, MAX_STONES)
    field = np.zeros(count * _CELLS + 1)
    place = corner - first * _CELLS
    is_inside = (place < field.shape).all(axis=1)
    order = np.argsort(frame, kind="stable")
    order = order[is_inside[order]]
    for group in np.split(order, np.flatnonzero(np.diff(frame[order])) + 1):
        i, j = place[group].T
        before = field[i, j]
        np.maximum.at(field, (i, j), depth[group])
        is_deeper = field[i, j] > before + _CHANGE
        time = min(float(_FRAME * frame[group[0]]), end)
        for column, row in _stones_at(i[is_deeper], j[is_deeper]):
            part = field[_of_stone(column), _of_stone(row)]
            stone = (int(first[0]) + column, int(first[1]) + row)
            ruts.time.setdefault(stone, []).append(time)
            ruts.depth.setdefault(stone, []).append(part.copy())
    return ruts


def _of_stone(k: int) -> slice:
    """The corners of the cells of the stones in a column or row, with those on both edges."""
    return slice(k * _CELLS, (k + 1) * _CELLS + 1)


def _stones_at(i: _Ints, j: _Ints) -> set[tuple[int, int]]:
    """Columns and rows of the stones that have any of the corners (n,) `i` and `j`; those on edges
    belong to several stones.
    """
    stones: set[tuple[int, int]] = set()
    for back_i in (0, 1):
        for back_j in (0, 1):
            columns = (i - back_i) // _CELLS
            rows = (j - back_j) // _CELLS
            stones |= set(zip(columns.tolist(), rows.tolist(), strict=True))
    return stones


def _presses(traces: Traces, robot: RobotParameters) -> tuple[_Ints, _Ints, Array]:
    """Frames (n,), corners of cells (n, 2) and depths (n,) [m] at which tracks press the soil."""
    sinkage = sinkage_of(traces)
    assert sinkage is not None
    length = robot.contact_length
    width = robot.track_width
    along = np.linspace(-length / 2, length / 2, int(np.ceil(length / _CELL)) + 1)
    across = np.linspace(-width / 2, width / 2, int(np.ceil(width / _CELL)) + 1)
    x, y = (grid.ravel() for grid in np.meshgrid(along, across))
    # a state has what was pressed until its time
    frame = np.ceil(traces.time / _FRAME).astype(int)
    frames = []
    corners = []
    depths = []
    for k, side in enumerate((robot.half_gauge, -robot.half_gauge)):
        footprint = np.stack([x, y + side], axis=-1)
        place = se2.to_world(traces.pose[:, None], footprint)  # (T, P, 2)
        corners.append(np.rint(place / _CELL).astype(int).reshape(-1, 2))
        frames.append(frame.repeat(len(footprint)))
        depths.append(sinkage[:, k].repeat(len(footprint)))
    return np.concatenate(frames), np.concatenate(corners), np.concatenate(depths)


def send_ruts(recording: Recording, ruts: Ruts) -> None:
    """Send the stones with ruts, which are flat until a track comes."""
    if not ruts.stones:
        return
    deepest = ruts.deepest
    grid = np.arange(_CELLS + 1)
    i, j = (values.ravel() for values in np.meshgrid(grid, grid, indexing="ij"))
    # two triangles per cell, from the numbers of its corners
    corner = (grid[:-1, None] * (_CELLS + 1) + grid[:-1]).ravel()
    lower = np.stack([corner, corner + _CELLS + 1, corner + _CELLS + 2], axis=-1)
    upper = np.stack([corner, corner + _CELLS + 2, corner + 1], axis=-1)
    triangles = np.concatenate([lower, upper])

    for column, row in ruts.stones:
        time = ruts.time[column, row]
        states = [state.ravel() for state in ruts.depth[column, row]]
        if time[0] > 0:
            time = [0.0, *time]
            states = [np.zeros_like(states[0]), *states]
        depth = np.stack(states)  # (n, corners)
        position = np.empty((*depth.shape, 3))
        position[..., 0] = STONE * column + _CELL * i
        position[..., 1] = STONE * row + _CELL * j
        position[..., 2] = -depth
        tone = np.array(TONES[(column + row) % 2], float)
        light = 1 - (1 - _DARKEST) * depth / deepest
        colour = np.rint(light[..., None] * tone).astype(np.uint8)

        entity = f"{RUTS}/{column}_{row}"
        recording.still(entity, rr.Mesh3D.from_fields(triangle_indices=triangles))
        columns = rr.Mesh3D.columns(
            vertex_positions=position.reshape(-1, 3), vertex_colors=colour.reshape(-1, 3)
        )
        counts = np.full(len(time), depth.shape[1])
        recording.rows(entity, np.array(time), columns.partition(counts))
