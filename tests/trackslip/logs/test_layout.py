"""Columns with other names and units, headers of other programs, arrays and data frames."""

from dataclasses import replace

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from plain_drives import GEOMETRY, wandered

import trackslip
from trackslip.errors import InvalidValueError, LogError
from trackslip.identification.source import ReadOptions, source_of_frame
from trackslip.kinematics import RobotGeometry
from trackslip.logs.layout import SCALE, Layout
from trackslip.logs.logfile import read_log
from trackslip.logs.runlog import RunLog
from trackslip.logs.table import to_table

LOG = wandered(duration=20.0)
COLUMNS = ["run", "t", "omega_l", "omega_r", "x", "y", "phi", "valid"]
OURS = to_table([LOG]).select(COLUMNS)
DEGREE = np.pi / 180
THEIRS = {
    "run": OURS["run"],
    "stamp": 1e3 * OURS["t"].to_numpy(),
    "left_rpm": OURS["omega_l"].to_numpy() * 30 / np.pi,
    "right_rpm": OURS["omega_r"].to_numpy() * 30 / np.pi,
    "px": 1e3 * OURS["x"].to_numpy(),
    "py": 1e3 * OURS["y"].to_numpy(),
    "yaw": OURS["phi"].to_numpy() / DEGREE,
    "valid": OURS["valid"],
}
TO_OURS = "t=stamp:ms,omega_l=left_rpm:rpm,omega_r=right_rpm:rpm,x=px:mm,y=py:mm,phi=yaw:deg"
SIZE = ReadOptions(GEOMETRY.half_gauge, GEOMETRY.sprocket_radius)


def same(run):
    np.testing.assert_allclose(run.time, LOG.time, atol=1e-9)
    np.testing.assert_allclose(run.omega, LOG.omega, atol=1e-9)
    known = LOG.is_valid
    np.testing.assert_allclose(run.pose[known], LOG.pose[known], atol=1e-9)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_one_option_renames_and_converts(tmp_path, kind):
    file = tmp_path / f"log.{kind}"
    frame = pa.table(THEIRS).to_pandas()
    getattr(frame, f"to_{kind}")(file, index=False)
    (run,) = read_log(file, layout=Layout(TO_OURS)).runs
    same(run)
    (run,) = trackslip.load(file, columns=dict(pair.split("=") for pair in TO_OURS.split(",")))
    same(run)


@pytest.mark.parametrize(
    ("ours", "theirs", "factor"), [("omega", "v:m/s", 1.0), ("omega", "v:cm/s", 100.0)]
)
def test_speeds_of_belts_are_divided_by_the_radius(ours, theirs, factor):
    column = theirs.partition(":")[0]
    columns = {name: OURS[name].to_numpy() for name in COLUMNS}
    option = {}
    for side in ("l", "r"):
        of_sprocket = columns.pop(f"{ours}_{side}")
        columns[f"{column}_{side}"] = factor * GEOMETRY.sprocket_radius * of_sprocket
        option[f"{ours}_{side}"] = theirs.replace(":", f"_{side}:")
    (run,) = source_of_frame(pa.table(columns), replace(SIZE, layout=Layout(option))).logs
    same(run)


@pytest.mark.parametrize(
    ("ours", "unit", "value", "expected"),
    [
        ("t", "ms", 1500.0, 1.5),
        ("t", "us", 1500.0, 0.0015),
        ("t", "ns", 1500.0, 1.5e-6),
        ("t", "min", 1.5, 90.0),
        ("omega_r", "deg/s", 180.0, np.pi),
        ("omega_r", "rpm", 30.0, np.pi),
        ("omega_r", "turn/s", 0.5, np.pi),
        ("angle_l", "deg", 180.0, np.pi),
        ("angle_l", "turn", 0.5, np.pi),
        ("x", "cm", 250.0, 2.5),
        ("y", "mm", 2500.0, 2.5),
        ("v", "cm/s", 250.0, 2.5),
        ("v", "mm/s", 2500.0, 2.5),
        ("v", "km/h", 36.0, 10.0),
        # motion of belts on sprockets of 50 cm
        ("omega_l", "km/h", 36.0, 20.0),
        ("omega_r", "mm/s", 2500.0, 5.0),
        ("angle_l", "cm", 250.0, 5.0),
        ("angle_r", "m", 2.5, 5.0),
    ],
)
def test_units_are_those_of_the_si(ours, unit, value, expected):
    layout = Layout(f"{ours}=a:{unit}", robot=RobotGeometry(1.0, 0.5))
    field = layout.applied(pa.table({"a": [value]}), "log.csv").schema.field(ours)
    assert value * float(field.metadata[SCALE]) == pytest.approx(expected, rel=1e-12)


def test_a_chosen_column_replaces_one_of_our_name():
    table = pa.table({"t": [0.0, 1.0], "x": [8.0, 9.0], "px": [1.0, 2.0], "y": [3.0, 4.0]})
    found = Layout("x=px").applied(table, "log.csv")
    assert found.column_names == ["t", "y", "x"]
    assert found["x"].to_pylist() == [1.0, 2.0]
    swapped = Layout("x=y,y=x").applied(table, "log.csv")
    assert swapped["x"].to_pylist() == [3.0, 4.0]
    assert swapped["y"].to_pylist() == [8.0, 9.0]


def test_distances_of_belts_are_angles_times_the_radius():
    angle = np.linspace(0.0, 50.0, 200)
    distance = 1e3 * GEOMETRY.sprocket_radius * angle  # [mm]
    columns = {
        "t": np.arange(200) * 0.1,
        "left": distance,
        "right": distance,
        "x": np.zeros(200),
        "y": np.zeros(200),
    }
    layout = Layout("angle_l=left:mm,angle_r=right:mm")
    (run,) = source_of_frame(pa.table(columns), replace(SIZE, layout=layout)).logs
    np.testing.assert_allclose(run.omega[1:], angle[1] / 0.1)


def test_speeds_of_belts_take_the_radius():
    table = pa.table({"t": [0.0], "v": [1.0]})
    with pytest.raises(InvalidValueError, match="omega_l=v:m/s is motion of the belts"):
        Layout("omega_l=v:m/s").applied(table, "log.csv")


@pytest.mark.parametrize("separator", ["T", " "])
@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_times_in_a_file_may_be_dates(tmp_path, separator, zone):
    file = tmp_path / "log.csv"
    rows = [f"2026-05-03{separator}10:00:{k:02d}.250{zone},1,1,0,0" for k in range(5)]
    file.write_text("\n".join(["t,omega_l,omega_r,x,y", *rows]))
    (run,) = read_log(file).runs
    np.testing.assert_allclose(np.diff(run.time), 1.0)


def test_times_of_day_are_answered_with_a_date(tmp_path):
    file = tmp_path / "log.csv"
    rows = [f"10:00:{k:02d},1,1,0,0" for k in range(5)]
    file.write_text("\n".join(["t,omega_l,omega_r,x,y", *rows]))
    with pytest.raises(LogError, match="'10:00:00' is not a number or a date with a time, as 2026"):
        read_log(file)


def test_a_damaged_cell_is_shown_as_it_stands_in_the_file(tmp_path):
    file = tmp_path / "log.csv"
    frame = pa.table(THEIRS).to_pandas().astype({"left_rpm": object})
    frame.loc[3, "left_rpm"] = "12,5"
    frame.to_csv(file, index=False)
    (note,) = read_log(file, layout=Layout(TO_OURS)).notes
    assert note.endswith("row 4, column omega_l: '12,5' is not a finite number")


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ("omega_l=left_rmp:rpm", r"has no column 'left_rmp' \(did you mean left_rpm\?\)"),
        ("omega_q=left_rpm", r"columns = 'omega_q': must be one of run, t, .*mean omega_"),
        ("omega_l=left_rpm:rmp", "in a known unit: one of rad/s, deg/s, rpm, turn/s"),
        ("valid=valid:deg", "left out: the column has no unit"),
        ("omega_l", "must be NAME=COLUMN or NAME=COLUMN:UNIT"),
        ("t=stamp,t=px", "columns = 't': must be there once"),
    ],
)
def test_typos_in_the_option_are_told_in_a_line(columns, said):
    with pytest.raises((LogError, InvalidValueError), match=said) as refused:
        Layout(columns).applied(pa.table(THEIRS), "log.csv")
    assert "\n" not in str(refused.value)


RECOGNISED = {
    ",".join(THEIRS): TO_OURS.replace(":ms", "").replace(":mm", ""),
    "time_ms,enc_left,enc_right,X [mm],Y [mm]": "--columns 't=time_ms:ms,ticks_l=enc_left,"
    "ticks_r=enc_right,x=X [mm]:mm,y=Y [mm]:mm' --ticks-per-turn N",
    "t,wl,wr,pose.position.x,pose.position.y,pose.orientation.z,pose.orientation.w": "--columns "
    "omega_l=wl,omega_r=wr,x=pose.position.x,y=pose.position.y",
    "t,v_left,v_right,x,y": "--columns omega_l=v_left:m/s,omega_r=v_right:m/s",
    "t,vl,vr,x,y": "--columns omega_l=vl:m/s,omega_r=vr:m/s",
    "t,left_mm_s,right_mm_s,x,y": "--columns omega_l=left_mm_s:mm/s,omega_r=right_mm_s:mm/s",
    "timestamp,speedL,speedR,theta": "--columns t=timestamp,omega_l=speedL,omega_r=speedR,"
    "phi=theta",
}


@pytest.mark.parametrize(("header", "option"), RECOGNISED.items())
def test_a_header_of_another_program_is_answered_with_the_option(tmp_path, header, option):
    file = tmp_path / "log.csv"
    count = header.count(",") + 1
    rows = [",".join([str(0.1 * k)] * count) for k in range(9)]
    # headings of 300 are no radians
    rows.append(",".join(["9.5"] + ["300"] * (count - 1)) if "yaw" in header else rows[-1])
    file.write_text("\n".join([header, *rows]))
    with pytest.raises(LogError) as refused:
        read_log(file)
    assert f"{option} reads it" in str(refused.value)


def test_a_header_that_is_not_recognised_is_just_refused(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("a,b,c\n1,2,3\n")
    said = r"has no column t, omega_l, omega_r, x, y; found 'a, b, c'$"
    with pytest.raises(LogError, match=said):
        read_log(file)


@pytest.mark.parametrize(("unit", "step"), [("ms", 20), ("us", 20_000), ("ns", 20_000_000)])
def test_units_of_times_are_recognised_by_their_steps(tmp_path, unit, step):
    file = tmp_path / "log.csv"
    start = 1_700_000_000 * 50 * step
    rows = [f"{start + k * step},1,1,0,0" for k in range(5)]
    file.write_text("\n".join(["stamp,omega_l,omega_r,x,y", *rows]))
    with pytest.raises(LogError, match=f"--columns t=stamp:{unit} reads it"):
        read_log(file)


@pytest.mark.parametrize("library", [pa.table, lambda t: pa.table(t).to_pandas(), pl.DataFrame])
def test_data_frames_are_read_as_files_are(library):
    columns = {name: OURS[name].to_numpy() for name in COLUMNS}
    (run,) = source_of_frame(library(columns), SIZE).logs
    same(run)


def test_times_of_a_data_frame_may_be_dates():
    frame = OURS.to_pandas()
    frame["t"] = pd.Timestamp("2026-01-01") + pd.to_timedelta(frame["t"], unit="s")
    (run,) = source_of_frame(frame, SIZE).logs
    np.testing.assert_allclose(run.time - run.time[0], LOG.time - LOG.time[0], atol=1e-6)


def test_identify_takes_a_data_frame_with_other_names():
    frame = pl.DataFrame(pa.table(THEIRS).to_pandas())
    found = trackslip.identify(frame, GEOMETRY, columns=TO_OURS)
    plain = trackslip.identify(OURS, GEOMETRY)
    offset = plain.laws["icr_radius"].offset
    assert found.laws["icr_radius"].offset == pytest.approx(offset, rel=1e-4)


@pytest.mark.parametrize("has_heading", [True, False])
def test_a_log_of_arrays_is_that_of_the_table(has_heading):
    known = LOG.is_valid
    pose = LOG.pose[known].T if has_heading else LOG.pose[known, :2].T
    run = RunLog.from_arrays(
        encoders=(LOG.time, *LOG.omega.T),
        poses=(LOG.time[known], *pose),
        gyro=(LOG.time, np.ones(len(LOG.time))),
        geometry=GEOMETRY,
    )
    np.testing.assert_array_equal(run.omega, LOG.omega)
    np.testing.assert_array_equal(run.pose[known, : len(pose)], pose.T)
    np.testing.assert_array_equal(run.is_valid, known)
    assert run.has_heading.any() == has_heading
    np.testing.assert_allclose(run.gyro[1:], 1.0)
    assert run.metadata["geometry"]["half_gauge"] == GEOMETRY.half_gauge


def test_arrays_at_times_of_their_own_keep_the_angles():
    """Poses between readings have rows with the speeds of the next reading; others are beyond."""
    posed = np.arange(-1.0, 25.0, 0.03)
    path = np.column_stack([posed, posed, posed / 10])
    run = RunLog.from_arrays((LOG.time, *LOG.omega.T), (posed, *path.T))
    turned = np.diff(run.time) @ run.omega[1:]
    expected = np.diff(LOG.time) @ LOG.omega[1:]
    np.testing.assert_allclose(turned, expected, atol=1e-9)
    is_beyond = (posed < LOG.time[0]) | (posed > LOG.time[-1])
    assert len(run.beyond) == is_beyond.sum()


T3 = np.arange(3.0)
NAN = np.array([0.0, np.nan, 1.0])


@pytest.mark.parametrize(
    ("encoders", "poses", "said"),
    [
        ((T3, T3), (T3, T3, T3), r"encoders: must be arrays \(t, omega_l, omega_r\), not 2$"),
        (np.ones((9, 3)), (T3, T3, T3), r"not 9; for the columns of a table give \*table.T"),
        ((T3, T3, T3[:2]), (T3, T3, T3), r"encoders: omega_r has shape \(2,\), must be \(n,\)"),
        ((T3, T3, T3), (T3, T3[:2], T3), r"poses: x has shape \(2,\), must be \(n,\) like t"),
        ((T3, T3, NAN), (T3, T3, T3), r"encoders: omega_r\[1\] is nan, must be finite"),
        ((T3[::-1], T3, T3), (T3, T3, T3), "encoders: t must be finite and ascend"),
        ((T3, T3, T3), (T3, ["a", "b", "c"], T3), r"poses: must be arrays .* of numbers"),
        ((T3, T3, T3), ([], [], []), "poses: has no rows"),
    ],
)
def test_arrays_of_wrong_shape_are_named(encoders, poses, said):
    with pytest.raises(LogError, match=said):
        RunLog.from_arrays(encoders, poses)
