"""Pieces from files: height fields from PNG pictures and from meshes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from sim.terrain.fields import HeightField, require_heights
from sim.terrain.limits import MAX_LOOKED_AT, MAX_SAMPLES, require_between, require_height, require_length
from sim.terrain.pieces import Placed, Site
from trackslip.errors import SettingsFileError, first_line, require, require_at_most
from trackslip.kinematics import Array

_CHUNK = 200_000  # pairs of a triangle and a sample that are looked at together
_MESHES = (".obj", ".stl", ".msh")
_MIN_CELL, _MAX_CELL = 0.005, 1.0  # [m]
_EDGE = 1e-9  # by which a sample may lie outside of a triangle, as a share of its size


@dataclass(frozen=True)
class Picture:
    """A height field from a PNG picture seen from above: right is the way to drive, light is high.

    MuJoCo reads it with 256 shades of grey; its darkest is the lowest, its lightest the highest.
    """

    file: str
    """The picture."""
    height: float = 0.3
    """Height of the lightest above the darkest pixel [m]."""
    length: float = 4.0
    """Length from the first to the last column [m]."""
    width: float = math.inf
    """Width from the first to the last row [m]; inf: that of the course."""

    def __post_init__(self) -> None:
        require_height("height", self.height)
        require(Path(self.file).suffix.lower() == ".png", "file", self.file, "a .png file")
        self._field  # noqa: B018  reads the file now, so that its errors come now

    @cached_property
    def _field(self) -> HeightField:
        spec = mujoco.MjSpec()
        spec.add_hfield(name="picture", file=_absolute(self.file), size=[1.0, 1.0, 1.0, 1.0])
        model = _compiled(spec, self.file)
        shares = model.hfield_data.reshape(model.hfield_nrow[0], model.hfield_ncol[0]).astype(float)
        return HeightField(self.height * shares, self.length, self.width)

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        return self._field.place(site)


@dataclass(frozen=True)
class Mesh:
    """The upper surface of a mesh, sampled as a height field: overhangs are filled, walls take a cell.

    It is driven along its x axis and has z up. Where it has a hole, it is as low as its lowest point.
    """

    file: str
    """The mesh: OBJ, STL or MSH."""
    cell: float = 0.05
    """Distance of the samples [m]."""
    scale: float = 1.0
    """Metres in a unit of the file."""

    def __post_init__(self) -> None:
        require(Path(self.file).suffix.lower() in _MESHES, "file", self.file, f"a mesh: {', '.join(_MESHES)}")
        require_between("cell", self.cell, _MIN_CELL, _MAX_CELL, "m")
        require_between("scale", self.scale, 1e-6, 1e6)
        self._field  # noqa: B018  reads the file now, so that its errors come now

    @cached_property
    def _field(self) -> HeightField:
        vertices, faces = _read_mesh(self.file)
        vertices = vertices * self.scale
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        length, width, _ = (float(size) for size in high - low)
        require_length("length of the mesh", length)
        require_length("width of the mesh", width)
        columns, rows = (max(1, round(size / self.cell)) + 1 for size in (length, width))
        require_at_most("samples of the mesh", rows * columns, MAX_SAMPLES)
        cells = np.array([length / (columns - 1), width / (rows - 1), 1.0])
        heights = highest((vertices - low) / cells, faces, (rows, columns))
        require_heights(heights)
        return HeightField(heights, length, width)

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        return self._field.place(site)


def highest(vertices: Array, faces: np.ndarray, shape: tuple[int, int]) -> Array:
    """Largest height (rows, columns) of triangles above each whole (column, row); 0 where there is none.

    The vertices (V, 3) have x in columns, y in rows, and z >= 0; faces (F, 3) are their indices.
    """
    heights = np.zeros(shape)
    corners = vertices[faces]  # (F, 3, 3)
    last = np.array([shape[1] - 1, shape[0] - 1])
    begin = np.clip(np.ceil(corners[..., :2].min(axis=1) - _EDGE), 0, last).astype(int)  # (F, 2)
    end = np.clip(np.floor(corners[..., :2].max(axis=1) + _EDGE), -1, last).astype(int) + 1
    size = np.maximum(end - begin, 0)
    samples = size.prod(axis=1)
    require_at_most("samples near the mesh's triangles", int(samples.sum()), MAX_LOOKED_AT)
    chunk = np.cumsum(samples) // _CHUNK
    for k in np.unique(chunk):
        some = chunk == k
        _raise_to(heights, corners[some], begin[some], size[some], samples[some])
    return heights


def _raise_to(heights: Array, corners: Array, begin: np.ndarray, size: np.ndarray, samples: np.ndarray) -> None:
    """Raise the heights to those of the triangles (F, 3, 3), each at its block of samples."""
    face = np.repeat(np.arange(len(corners)), samples)
    index = np.arange(len(face)) - np.repeat(np.cumsum(samples) - samples, samples)  # within the block
    row, column = np.divmod(index, size[face, 0])
    row, column = row + begin[face, 1], column + begin[face, 0]
    at = np.stack([column, row], axis=-1) - corners[face, 0, :2]
    u, v = (corners[face, k] - corners[face, 0] for k in (1, 2))
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (at[:, 0] * v[:, 1] - at[:, 1] * v[:, 0]) / area
        t = (u[:, 0] * at[:, 1] - u[:, 1] * at[:, 0]) / area
    inside = (s >= -_EDGE) & (t >= -_EDGE) & (s + t <= 1 + _EDGE)  # not for upright triangles, whose area is 0
    z = corners[face, 0, 2] + s * u[:, 2] + t * v[:, 2]
    np.maximum.at(heights, (row[inside], column[inside]), z[inside])


def _read_mesh(file: str) -> tuple[Array, np.ndarray]:
    """Vertices (V, 3) and triangles (F, 3) of a mesh file."""
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="mesh", file=_absolute(file))
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # of surfaces that enclose no volume
    model = _compiled(spec, file)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.mesh_quat[0])  # the compiler moves meshes to their axes of inertia
    vertices = model.mesh_vert.astype(float) @ rotation.reshape(3, 3).T + model.mesh_pos[0]
    return vertices, model.mesh_face


def _compiled(spec: mujoco.MjSpec, file: str) -> mujoco.MjModel:
    try:
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise SettingsFileError(f"{file}: {first_line(error).removeprefix('Error: ')}") from error


def _absolute(file: str) -> str:
    """`file`, which MuJoCo would look for beside a model."""
    return str(Path(file).absolute())
