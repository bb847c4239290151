import numpy as np
import pyarrow as pa
import pytest

from trackslip.errors import LogError
from trackslip.logs.checks import unwrapped_headings
from trackslip.logs.logfile import read_log
from trackslip.logs.table_reader import runs_from_table

NAMES = ["run", "t", "omega_l", "omega_r", "x", "y", "phi"]


def row_of(k):
    """Encoders, and a pose in every second row."""
    pose = [0.05 * k, -0.5, 0.1 * k] if k % 2 == 0 else [""] * 3
    return ["a", 0.1 * k, 1.0, 1.5 + 0.25 * k, *pose]


ROWS = [row_of(k) for k in range(12)]


def text(rows=ROWS, names=NAMES, separator=","):
    lines = [separator.join(map(str, row)) for row in (names, *rows)]
    return "\n".join(lines) + "\n"


def read(path, content):
    file = path / "drive 7.csv"
    file.write_text(content)
    return read_log(file)


PLAIN = text()
UNITS = ["", "s", "rad/s", "rad/s", "m", "m", "rad"]
SPELLINGS = {
    "blanks": text(separator=" , "),
    "a comment": "# robot 1, Monday\n#\n" + PLAIN,
    "a header of numpy.savetxt": "# robot 1\n# " + PLAIN,
    "each row twice": text([row for row in ROWS for _ in range(2)]),
    "semicolons": text(separator=";"),
    "tabs": text(separator="\t"),
    "decimal commas": text(separator=";").replace(".", ","),
    "a row of units": PLAIN.replace("\n", "\n-,s,rad/s,rad/s,m,m,rad\n", 1),
    "all of it": "# robot\n" + text([UNITS, *ROWS], separator=" ; ").replace(".", ","),
    "a mark of the byte order": "\ufeff" + PLAIN,
}


@pytest.mark.parametrize("content", SPELLINGS.values(), ids=SPELLINGS)
def test_other_spellings_are_read_alike(tmp_path, content):
    (plain,) = read(tmp_path, PLAIN).runs
    found = read(tmp_path, content)
    (run,) = found.runs
    assert found.warnings == ()
    assert run.run == "a"
    for name in ("time", "omega", "pose", "valid"):
        np.testing.assert_array_equal(getattr(run, name), getattr(plain, name))


@pytest.mark.parametrize(
    ("column", "unit", "must"), [("phi", "deg", "rad"), ("t", "ms", "s"), ("x", "mm", "m")]
)
def test_a_row_of_other_units_is_refused(tmp_path, column, unit, must):
    units = dict(zip(NAMES, ["-", "s", "rad/s", "rad/s", "m", "m", "rad"], strict=True))
    units[column] = unit
    with pytest.raises(LogError, match=f"column {column}: in '{unit}', must be in {must}"):
        read(tmp_path, text([[*units.values()], *ROWS]))


def test_a_table_without_run_is_one_run_named_after_its_file(tmp_path):
    (run,) = read(tmp_path, text([row[1:] for row in ROWS], NAMES[1:])).runs
    assert run.run == "drive 7"
    assert len(run.time) == len(ROWS)


@pytest.mark.parametrize(
    "names",
    [
        ("qx", "qy", "qz", "qw"),
        ("pose.orientation.x", "pose.orientation.y", "pose.orientation.z", "pose.orientation.w"),
        ("orientation_z", "orientation_w"),
    ],
)
def test_quaternions_of_any_norm_are_headings(tmp_path, names):
    heading = np.linspace(-3.0, 3.0, len(ROWS))
    level = 0.0 * heading
    parts = {"x": level, "y": level, "z": 2 * np.sin(heading / 2), "w": 2 * np.cos(heading / 2)}
    rows = []
    for k, row in enumerate(ROWS):
        quaternion = [float(parts[name[-1]][k]) for name in names]
        rows.append([*row[:4], 0.0, 0.0, *quaternion])
    (run,) = read(tmp_path, text(rows, [*NAMES[:6], *names])).runs
    np.testing.assert_allclose(run.pose[:, 2], heading, atol=1e-12)


def test_a_part_of_a_quaternion_is_no_heading(tmp_path):
    said = "columns qz are of a quaternion without w: give phi, the heading in rad, or"
    with pytest.raises(LogError, match=said):
        read(tmp_path, text(names=[*NAMES[:6], "qz"]))


@pytest.mark.parametrize("names", [NAMES, [*NAMES[:4], "phi"]])
def test_headings_without_positions_are_poses(tmp_path, names):
    no_position = [""] * (len(names) - 5)
    rows = [[*row[:4], *no_position, 0.1 * k] for k, row in enumerate(ROWS)]
    found = read(tmp_path, text(rows, names))
    (run,) = found.runs
    assert found.warnings == ()
    assert run.is_valid.all()
    assert run.has_heading.all()
    assert not run.has_place.any()
    np.testing.assert_allclose(run.pose[:, 2], 0.1 * np.arange(12))
    assert np.isnan(run.pose[:, :2]).all()


def test_headings_are_unwrapped_but_degrees_are_not():
    heading = np.linspace(0.0, 20.0, 100)
    wrapped = (heading + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(unwrapped_headings(wrapped), heading)
    np.testing.assert_array_equal(unwrapped_headings(heading), heading)
    degrees = np.degrees(heading) % 360
    np.testing.assert_array_equal(unwrapped_headings(degrees), degrees)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_any_number_of_rows_of_one_time_is_one(order):
    """Encoders, gyro and pose in rows of their own; every fifth time has a pose."""
    cells = []
    for k in range(50):
        parts = (
            {"omega_l": k, "omega_r": -k},
            {"gyro": 0.01 * k},
            {"x": k, "y": 2 * k, "phi": 0.1, "valid": True},
        )
        has_pose = k % 5 == 0
        for part in order:
            if part < 2 or has_pose:
                cells.append({"t": 0.05 * k, **parts[part]})
    names = ("t", "omega_l", "omega_r", "gyro", "x", "y", "phi", "valid")
    table = pa.table({name: pa.array([row.get(name) for row in cells]) for name in names})
    found = runs_from_table(table, "three.csv")
    (run,) = found.runs
    assert found.warnings == ()
    np.testing.assert_allclose(run.time, 0.05 * np.arange(50))
    np.testing.assert_array_equal(run.omega, np.arange(50)[:, None] * [1, -1])
    np.testing.assert_allclose(run.gyro, 0.01 * np.arange(50))
    np.testing.assert_array_equal(np.flatnonzero(run.is_valid), np.arange(0, 50, 5))
    np.testing.assert_array_equal(run.pose[run.is_valid, 1], 2 * np.arange(0, 50, 5))


def at_random(posed):
    return np.random.default_rng(0).permutation(len(posed))


def poses_late(posed):
    """Poses arrive 40 rows later."""
    return np.argsort(np.arange(len(posed)) + 40 * posed)


@pytest.mark.parametrize("order", [np.argsort, at_random, poses_late])
def test_rows_of_one_sensor_after_those_of_another_are_sorted(order):
    """All rows with encoders before all with poses, in no order, or as they arrive: poses 0.8 s
    late.
    """
    time = 0.02 * np.arange(1200)
    posed = np.arange(1200) % 6 == 5
    rows = order(posed)
    wheels = np.where(posed, np.nan, 1.0)[rows]
    place = np.where(posed, time, np.nan)[rows]
    cells = {"t": time[rows], "omega_l": wheels, "omega_r": wheels, "x": place, "y": place}
    table = pa.table({name: pa.array(values, from_pandas=True) for name, values in cells.items()})
    found = runs_from_table(table, "sensors.csv")
    (run,) = found.runs
    assert found.notes[-1].endswith("row after its last encoder reading left out")
    np.testing.assert_array_equal(run.time, time[:-1])
    np.testing.assert_array_equal(run.is_valid, posed[:-1])


def test_poses_far_from_any_encoder_are_kept_apart(tmp_path):
    late = [["a", 100 + 0.1 * k, "", "", k, 0, 0] for k in range(5)]
    early = [["a", -100 + 0.1 * k, "", "", k, 0, ""] for k in range(3)]
    found = read(tmp_path, text([*early, *ROWS, *late]))
    (run,) = found.runs
    assert found.warnings == (
        "run 'a': 3 rows before its first encoder reading left out",
        "run 'a': 5 rows after its last encoder reading left out",
    )
    np.testing.assert_allclose(run.time, 0.1 * np.arange(12))
    before = -100 + 0.1 * np.arange(3)
    after = 100 + 0.1 * np.arange(5)
    np.testing.assert_allclose(run.beyond[:, 0], [*before, *after])
    assert run.between(0, 5).beyond is None
