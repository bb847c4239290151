"""Height fields from PNG pictures and from meshes."""

import struct
import zlib

import mujoco
import numpy as np
import pytest
from rays import look_down

from sim.terrain import Course, Mesh, Picture
from trackslip.errors import SettingsFileError


def write_png(path, grey):
    """A PNG of shades (rows, columns) uint8."""
    rows = b"".join(b"\0" + row.tobytes() for row in grey)
    header = struct.pack(">IIBBBBB", grey.shape[1], grey.shape[0], 8, 0, 0, 0, 0)
    data = b""
    for kind, body in ((b"IHDR", header), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")):
        data += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + data)


def test_a_picture_is_seen_from_above_and_light_is_high(tmp_path):
    grey = np.full((3, 5), 100, np.uint8)
    grey[0, 3] = 200  # left of the middle, beyond it
    grey[2, 1] = 50
    write_png(tmp_path / "hills.png", grey)
    course = Course((Picture(str(tmp_path / "hills.png"), height=0.3, length=4.0, width=2.0),))
    x, y = np.meshgrid(np.linspace(0.0, 4.0, 5), [1.0, 0.0, -1.0])
    np.testing.assert_allclose(course.height(x, y), 0.3 * (grey.astype(float) - 100.0) / 150.0, atol=1e-7)


def write_obj(path, vertices, faces):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()] + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines) + "\n")


def surface(rng, rows=9, columns=13):
    """Vertices and triangles of a rough surface, moved and turned by nothing, without volume."""
    x, y = np.meshgrid(np.linspace(3.0, 6.0, columns), np.linspace(-1.0, 1.0, rows))
    vertices = np.column_stack([x.ravel(), y.ravel(), rng.uniform(0.0, 0.4, x.size)])
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + columns + 1])
    upper = np.column_stack([corner, corner + columns + 1, corner + columns])
    return vertices, np.concatenate([lower, upper])


def test_a_mesh_is_its_upper_surface(tmp_path):
    vertices, faces = surface(np.random.default_rng(4))
    write_obj(tmp_path / "hills.obj", vertices, faces)
    course = Course((Mesh(str(tmp_path / "hills.obj"), cell=0.07),), width=4.0)
    grid = course.solids[1]
    assert grid.heights.shape == (30, 44)
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="hills", file=str(tmp_path / "hills.obj"))
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="hills")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    x, y = np.meshgrid(np.linspace(3.0, 6.0, 44), np.linspace(-1.0, 1.0, 30))
    inner = np.s_[1:-1, 1:-1]  # rays miss the edges
    points = np.column_stack([x[inner].ravel(), y[inner].ravel()])
    found, _ = look_down(model, data, points)
    sampled = grid.heights[inner].ravel()
    np.testing.assert_allclose(sampled - sampled.mean(), found - found.mean(), atol=1e-6)
    assert course.height(1e-6, np.linspace(-1.0, 1.0, 30)).mean() == pytest.approx(0.0, abs=1e-6)


def test_meshes_in_other_units_with_undersides_and_holes(tmp_path):
    vertices = np.array([[0, 0, 0], [2000, 0, 0], [2000, 1000, 500], [0, 1000, 500], [1000, 500, -300]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    write_obj(tmp_path / "wedge.obj", vertices, faces)
    heights = Course((Mesh(str(tmp_path / "wedge.obj"), 0.1, scale=1e-3),)).solids[1].heights
    np.testing.assert_allclose(heights - heights[0, 0], np.linspace(0.0, 0.5, 11)[:, None] * np.ones(21), atol=1e-6)
    write_obj(tmp_path / "triangle.obj", vertices[[0, 1, 2, 4]] / 1000, faces[:1])
    heights = Course((Mesh(str(tmp_path / "triangle.obj"), 0.1),)).solids[1].heights
    assert np.ptp(heights[1:, 0]) == 0.0  # beside the triangle
    assert heights[-1, -1] - heights[0, 0] == pytest.approx(0.5)


ONE_SIDED = "v 0 0 0\nv 1 0 0\nf 1 2 9\n"
NOT_FINITE = "v nan 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n"


@pytest.mark.parametrize(
    ("load", "name", "text"),
    [
        (Picture, "junk.png", "junk"),
        (Picture, "none.png", None),
        (Mesh, "junk.obj", "junk"),
        (Mesh, "mesh.obj", ONE_SIDED),
        (Mesh, "mesh.obj", NOT_FINITE),
        (Mesh, "none.obj", None),
    ],
)
def test_wrong_files_are_one_line(tmp_path, load, name, text):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    with pytest.raises(SettingsFileError) as error:
        load(str(path))
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)
