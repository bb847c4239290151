"""Pieces that are height fields: rough ground, heights of the user's, PNG pictures and meshes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from sim.terrain.limits import MAX_LENGTH, require_between, require_height, require_length
from sim.terrain.pieces import Placed, Site, smooth_step
from sim.terrain.solids import Grid
from trackslip.errors import InvalidValueError, SettingsFileError, first_line, require, require_at_most
from trackslip.kinematics import Array

_MAX_EXPONENT = 8.0
_CHUNK = 200_000  # pairs of a triangle and a sample that are looked at together
_MAX_SAMPLES = 1_000_000  # of a height field
_MAX_SIDE = 2000  # samples along a side of rough ground, whose spectrum takes four times its square
_MAX_LOOKED_AT = 100_000_000  # samples near triangles of a mesh, each triangle's counted
_MESHES = (".obj", ".stl", ".msh")
_MIN_CELL, _MAX_CELL = 0.005, 1.0  # [m]
_EDGE = 1e-9  # by which a sample may lie outside of a triangle, as a share of its size


@dataclass(frozen=True)
class Rough:
    """Rough ground, drawn with a power spectrum that falls with the wave number; it begins and ends level."""

    length: float = 4.0
    """Length [m]."""
    amplitude: float = 0.1
    """From the lowest to the highest point [m]."""
    exponent: float = 3.0
    """Power per area of wave numbers falls with the wave number to this power; 3: that of roads (ISO 8608)."""
    cell: float = 0.1
    """Size of a cell of the height field [m]."""
    blend: float = 0.5
    """Length over which it grows out of the level ground at either end [m]."""

    def __post_init__(self) -> None:
        require_length("length", self.length)
        require_height("amplitude", self.amplitude)
        require_between("exponent", self.exponent, 0.0, _MAX_EXPONENT)
        require_between("cell", self.cell, _MIN_CELL, self.length, "m, at most the length")
        require_between("blend", self.blend, 0.0, self.length / 2, "m, at most half of the length")

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        columns, rows = (max(2, round(size / self.cell)) + 1 for size in (self.length, site.width))
        require_at_most("cells along a side of rough ground", max(rows, columns), _MAX_SIDE)
        require_at_most("samples of rough ground", rows * columns, _MAX_SAMPLES)
        waves = _noise(rows, columns, self.exponent, site.rng)
        if self.blend > 0:
            x = np.linspace(0.0, self.length, columns)
            waves = waves * smooth_step(np.minimum(x, x[::-1]) / self.blend)
        waves[:, [0, -1]] = 0.0  # flush with what it lies between
        heights = site.z + waves * (self.amplitude / np.ptp(waves))
        end = site.x + self.length
        return Placed((Grid(site.x, self.length, site.width, heights),), end, site.z)


def _noise(rows: int, columns: int, exponent: float, rng: np.random.Generator) -> Array:
    """Gaussian noise (rows, columns) of mean 0 whose power per area of wave numbers is ~ wave number ** -exponent.

    It is cut from a square of twice the size: noise from a Fourier sum repeats itself from edge to edge.
    """
    size = 2 * max(rows, columns)
    wave_number = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
    wave_number[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((size, size))) * wave_number ** (-exponent / 2)
    noise = np.fft.irfft2(spectrum, (size, size))[:rows, :columns]
    return noise - noise.mean()


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights of the user's; the mean of the first column is at the height of what is before, and so on."""

    heights: Array
    """Heights (rows, columns) [m]: rows along y, to the left, columns along x, the way to drive."""
    length: float = 4.0
    """Length from the first to the last column [m]."""
    width: float = math.inf
    """Width from the first to the last row [m]; inf: that of the course."""

    def __post_init__(self) -> None:
        require_heights(self.heights)
        require_length("length", self.length)
        if self.width != math.inf:
            require_length("width", self.width)

    def place(self, site: Site) -> Placed:
        """See `Piece`."""
        heights = np.asarray(self.heights, float)
        width = site.width if self.width == math.inf else self.width
        heights = heights + (site.z - heights[:, 0].mean())
        end = site.x + self.length
        return Placed((Grid(site.x, self.length, width, heights),), end, float(heights[:, -1].mean()))


def require_heights(heights: Array) -> None:
    """Raise InvalidValueError unless `heights` is a table of finite heights that MuJoCo can hold."""
    try:
        shape = np.shape(heights)
    except ValueError:
        raise InvalidValueError("heights", heights, "rows of equal lengths") from None
    require(len(shape) == 2 and min(shape) >= 2, "shape of heights", shape, "(rows, columns), at least (2, 2)")
    require_at_most("samples of heights", int(np.prod(shape)), _MAX_SAMPLES)
    values = np.ravel(heights)
    wrong = values[~np.isfinite(values)] if values.dtype.kind in "iuf" else values
    require(len(wrong) == 0, "heights", wrong[:1].tolist(), "finite numbers")
    require_at_most("range of heights", float(np.ptp(heights)), MAX_LENGTH, "m")


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
        require_at_most("samples of the mesh", rows * columns, _MAX_SAMPLES)
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
    require_at_most("samples near the mesh's triangles", int(samples.sum()), _MAX_LOOKED_AT)
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
