"""Geoms of a MuJoCo model as shapes of a recording."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pyarrow as pa
import pytest

from experiments.recorder.model import MAX_STONES, TONES, send_geoms, send_paving, send_robot
from sim.robot.robot import SCANNED_GROUP, VISUAL_GROUP
from sim.tracks.drawing import BOX, CYLINDER, TrackLook

# a box 20 cm to the left, turned by 90 deg about x
PLACED = f'pos="0 .2 0" quat="{np.sqrt(0.5)} {np.sqrt(0.5)} 0 0" group="{VISUAL_GROUP}"'
MODEL = f"""
<mujoco>
  <asset>
    <material name="red" rgba="1 0 0 1"/>
    <material name="last" rgba="0 0 1 1"/>
    <mesh name="wedge" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"/>
    <hfield name="hill" nrow="2" ncol="3" size=".3 .1 .2 .1" elevation="0 0 1 0 0 1"/>
  </asset>
  <worldbody>
    <body name="shapes">
      <freejoint/>
      <geom name="of its material" type="box" size=".1 .2 .3" {PLACED} material="red"/>
      <geom name="of its own" type="box" size=".1 .1 .1" {PLACED} material="red" rgba="0 1 0 .5"/>
      <geom name="unset" type="box" size=".1 .1 .1" {PLACED}/>
      <geom name="cylinder" type="cylinder" size=".1 .2" group="{SCANNED_GROUP}"/>
      <geom name="capsule" type="capsule" size=".1 .2" group="{VISUAL_GROUP}"/>
      <geom name="sphere" type="sphere" size=".1" group="{VISUAL_GROUP}"/>
      <geom name="ellipsoid" type="ellipsoid" size=".1 .2 .3" group="{VISUAL_GROUP}"/>
      <geom name="wedge" type="mesh" mesh="wedge" group="{VISUAL_GROUP}" material="red"/>
      <geom name="hidden" type="box" size=".1 .1 .1" group="5"/>
    </body>
    <geom name="floor" type="plane" size="1 1 .1" pos="0 0 -1" group="{VISUAL_GROUP}"/>
    <geom name="hill" type="hfield" hfield="hill" group="{VISUAL_GROUP}" pos="1 0 0"/>
  </worldbody>
</mujoco>
"""


def shapes_of(model, body):
    """The shapes of a body in a recording, by entity."""
    shapes = {}
    recording = SimpleNamespace(still=shapes.__setitem__)
    send_geoms(recording, "it", model, model.body(body).id)
    return shapes


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(MODEL)


@pytest.fixture(scope="module")
def shapes(model):
    return shapes_of(model, "shapes")


def values(batch):
    """The numbers of a component."""
    column = batch.as_arrow_array()
    while pa.types.is_nested(column.type):
        column = column.flatten()
    return column.to_numpy(zero_copy_only=False)


def packed(red, green, blue, alpha):
    """A colour as rerun stores it."""
    return red << 24 | green << 16 | blue << 8 | alpha


def test_visible_geoms_but_planes_are_shapes_of_their_kind(model, shapes):
    kinds = {entity.removeprefix("it/"): type(shape).__name__ for entity, shape in shapes.items()}
    assert kinds == {
        r"of\ its\ material": "Boxes3D",
        r"of\ its\ own": "Boxes3D",
        "unset": "Boxes3D",
        "cylinder": "Cylinders3D",
        "capsule": "Cylinders3D",
        "sphere": "Ellipsoids3D",
        "ellipsoid": "Ellipsoids3D",
        "wedge": "Mesh3D",
    }
    assert list(shapes_of(model, "world")) == ["it/hill"]


def test_a_geoms_colour_is_its_own_or_else_that_of_its_material(shapes):
    for name, colour in (
        (r"of\ its\ material", packed(255, 0, 0, 255)),
        (r"of\ its\ own", packed(0, 255, 0, 128)),
        ("unset", packed(128, 128, 128, 255)),
    ):
        assert values(shapes[f"it/{name}"].colors) == [colour]
    assert values(shapes["it/wedge"].albedo_factor) == [packed(255, 0, 0, 255)]


def test_shapes_have_the_sizes_and_places_of_geoms(shapes):
    box = shapes[r"it/of\ its\ material"]
    np.testing.assert_allclose(values(box.half_sizes), [0.1, 0.2, 0.3], rtol=1e-6)
    np.testing.assert_allclose(values(box.centers), [0.0, 0.2, 0.0], rtol=1e-6)
    turn = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]  # w is last
    np.testing.assert_allclose(values(box.quaternions), turn, rtol=1e-6)
    for name in ("cylinder", "capsule"):
        shape = shapes[f"it/{name}"]
        np.testing.assert_allclose(values(shape.radii), [0.1], rtol=1e-6)
        np.testing.assert_allclose(values(shape.lengths), [0.4], rtol=1e-6)
    np.testing.assert_allclose(values(shapes["it/sphere"].half_sizes), [0.1] * 3, rtol=1e-6)
    ellipsoid = values(shapes["it/ellipsoid"].half_sizes)
    np.testing.assert_allclose(ellipsoid, [0.1, 0.2, 0.3], rtol=1e-6)


def triangles(shape):
    return values(shape.vertex_positions).reshape(-1, 3, 3)


def test_a_mesh_has_the_faces_of_its_asset_where_they_are(shapes):
    """MuJoCo moves a mesh to its principal axes, and its geom back."""
    found = triangles(shapes["it/wedge"])
    assert found.shape == (4, 3, 3)
    millimetres = np.abs(1e3 * found.reshape(-1, 3)).round().astype(int)
    corners = {tuple(corner) for corner in millimetres.tolist()}
    assert corners == {(0, 0, 0), (100, 0, 0), (0, 100, 0), (0, 0, 100)}
    # normals point outwards, away from the middle
    normals = values(shapes["it/wedge"].vertex_normals).reshape(-1, 3, 3)
    outwards = found.mean(axis=1) - found.reshape(-1, 3).mean(axis=0)
    assert (np.einsum("fi,fi->f", normals[:, 0], outwards) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-6)


def test_a_height_field_is_as_high_as_mujocos_rays_find_it(model):
    """A hill that rises to 0.2 m over the further half of its length of 0.6 m."""
    found = triangles(shapes_of(model, "world")["it/hill"])
    assert len(found) == 4
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = np.zeros(1, np.int32)
    for corners in found:
        x, y, height = corners.mean(axis=0).astype(float)
        below = mujoco.mj_ray(model, data, [x, y, 1.0], [0.0, 0.0, -1.0], None, 1, -1, geom)
        assert model.geom(geom[0]).name == "hill"
        assert height == pytest.approx(1.0 - below, abs=1e-6)
    assert (found[..., 0].min(), found[..., 0].max()) == pytest.approx((0.7, 1.3))
    assert (found[..., 1].min(), found[..., 1].max()) == pytest.approx((-0.1, 0.1))


def paving(within, **options):
    """Stones around points: corners with the lowest coordinates (n, 2), heights of their tops (n,)
    and colours (n,).
    """
    shapes = {}
    send_paving(SimpleNamespace(still=shapes.__setitem__), np.array(within), **options)
    (stones,) = shapes.values()
    middle = values(stones.centers).reshape(-1, 3)
    half = values(stones.half_sizes)
    np.testing.assert_allclose(half[:2], [0.25, 0.25])  # slabs of half a metre
    return middle[:, :2] - half[:2], middle[:, 2] + half[2], values(stones.colors)


def test_stones_pave_three_metres_around_everything_in_two_tones():
    corner, top, colour = paving([(0.0, 0.2), (1.3, 0.4)])
    x, y = np.meshgrid(np.arange(-3.0, 4.5, 0.5), np.arange(-3.0, 3.5, 0.5))
    expected = np.column_stack([x.ravel(), y.ravel()])
    np.testing.assert_allclose(corner, expected)
    np.testing.assert_allclose(top, 0.0, atol=1e-7)
    is_odd = np.rint(2 * expected.sum(axis=1)).astype(int) % 2
    tones = [packed(*tone, 255) for tone in TONES]
    np.testing.assert_array_equal(colour, np.array(tones)[is_odd])


def test_stones_may_be_lower_left_out_or_too_many():
    corner, _, _ = paving([(0.0, 0.0)])
    fewer, top, _ = paving([(0.0, 0.0)], height=-0.2, without=[(0, 0), (-6, 2)])
    np.testing.assert_allclose(top, -0.2, atol=1e-7)
    left_out = {tuple(each) for each in corner.tolist()} - {tuple(each) for each in fewer.tolist()}
    assert left_out == {(0.0, 0.0), (-3.0, 1.0)}
    far, _, _ = paving([(0.0, 0.0), (1e4, 0.0)])
    assert np.ptp(far[:, 0]) == 0.5 * (MAX_STONES - 1)


@pytest.mark.parametrize("turns", [True, False])
def test_bodies_move_with_tracks_that_turn_or_rest(model, turns):
    """A belt around two wheels that runs 0.1 m, while the body goes ahead and turns left."""
    time = np.array([0.0, 0.5])
    half = np.sqrt(0.5)
    qpos = np.array([[0, 0, 0.1, 1, 0, 0, 0], [0.3, 0.1, 0.1, half, 0, 0, half]])
    travel = np.array([[0.0], [0.1]])
    look = TrackLook(np.array([[-0.2, 0.0, 0.05], [0.2, 0.0, 0.05]]), y=0.3, width=0.1)
    poses = {}
    still = {}
    moving = {}

    def shapes(entity, time, counts, solid, *, centers, quaternions):
        moving[entity] = (time, counts, centers, quaternions)

    recording = SimpleNamespace(
        poses=lambda entity, *where: poses.__setitem__(entity, where),
        still=still.__setitem__,
        shapes=shapes,
    )
    tracks = [("left", model.body("shapes").id, look)]
    send_robot(recording, "run", model, time, qpos, tracks, travel if turns else travel[:1])

    ((at, position, attitude),) = poses.values()
    assert list(poses) == ["run/robot/shapes"]
    np.testing.assert_array_equal(at, time)
    np.testing.assert_allclose(position, qpos[:, :3])
    np.testing.assert_allclose(attitude, [[0, 0, 0, 1], [0, 0, half, half]])  # w is last
    assert "run/robot/shapes/body/unset" in still

    pieces = look.pieces(travel[:, 0])
    for name, kind in (("boxes", BOX), ("wheels", CYLINDER)):
        mine = pieces.kind == kind
        entity = f"run/robot/shapes/left/{name}"
        if turns:
            times, counts, centres, quaternions = moving[entity]
            np.testing.assert_array_equal(times, time)
            np.testing.assert_array_equal(counts, mine.sum())
            np.testing.assert_allclose(centres, pieces.position[:, mine].reshape(-1, 3))
            assert quaternions.shape == (2 * mine.sum(), 4)
        else:
            centres = values(still[entity].centers).reshape(-1, 3)
            np.testing.assert_allclose(centres, pieces.position[0, mine], atol=1e-7)
    assert len(moving) == (2 if turns else 0)
