import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rrd import component, static

from experiments import recorder as recording
from experiments.cli import main
from experiments.common.traces import Traces
from experiments.recorder.run import parameters_of, series_of
from experiments.recorder.stream import write_recording
from sim.robot.parameters import RobotParameters
from trackslip.errors import OutputError
from trackslip.kinematics import RobotGeometry, track_slip
from trackslip.localization.scan import Plate
from trackslip.logs.logfile import read_runs, write_csv
from trackslip.logs.runlog import RunLog

TRACK = "track --reference circle --circle-duration 8 --circle-radius 0.8 --start -1.4 0.1 0.2"


@pytest.fixture(scope="module")
def driven(tmp_path_factory) -> tuple[Path, list[RunLog]]:
    logs = []
    folder = tmp_path_factory.mktemp("recording")
    for compensation in ("none", "icr_radius"):
        out = folder / compensation
        options = ["--compensation", compensation, "--obstacles", "posts", "--rrd"]
        main([*TRACK.split(), *options, "--out", str(out)])
        logs += read_runs(out / "runs.parquet")
    return folder, logs


FILES = {name: Path(name) / "recordings" / f"linear_{name}.rrd" for name in ("none", "icr_radius")}


def require_pose(file: Path, entity: str, log: RunLog) -> None:
    time, translation = component(file, entity, "translation")
    _, quaternion = component(file, entity, "quaternion")
    np.testing.assert_allclose(time, log.time, atol=1e-9)
    np.testing.assert_allclose(translation[:, :2], log.truth.pose[:, :2], atol=1e-6)
    x, y, z, w = quaternion.T.astype(float)  # rerun's order
    np.testing.assert_allclose([x, y], 0, atol=1e-7)
    heading = log.truth.pose[:, 2]
    assert np.ptp(heading) > 1  # the robot turned
    shown = 2 * np.arctan2(z, w)
    np.testing.assert_allclose(np.exp(1j * shown), np.exp(1j * heading), atol=1e-6)


def test_recordings_hold_one_run_or_several_side_by_side(driven, tmp_path):
    folder, logs = driven
    _, log = logs
    file = folder / FILES["icr_radius"]
    require_pose(file, "/run/robot/chassis", log)
    _, slip = component(file, "/run/slip/true", "scalars")
    geometry = RobotGeometry(**log.metadata["geometry"])
    twist = log.truth.twist[:, [0, 2]]
    between_rows = (twist[1:] + twist[:-1]) / 2
    expected = track_slip(log.omega[1:], between_rows, geometry)
    turning = np.abs(log.omega[1:]) > 0.3
    np.testing.assert_allclose(slip[1:][turning], expected[turning], atol=1e-12)
    assert np.isnan(slip[1:][~turning]).all()
    _, measured = component(file, "/run/sprocket/measured", "scalars")
    np.testing.assert_array_equal(measured, log.omega)
    both = tmp_path / "both.rrd"
    recording.record(both, logs)
    for log in logs:
        name = log.run.replace(" ", r"\ ")
        require_pose(both, f"/run/{name}/robot/chassis", log)
    reader = RrdReader(both)
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1


def test_data_hold_always_or_at_the_times_of_the_run(driven):
    folder, (log, _) = driven
    static_parts = 0
    for chunk in RrdReader(folder / FILES["none"]).stream():
        static_parts += chunk.is_static
        if not chunk.is_static:
            assert chunk.timeline_names == ["time"]
            time = chunk.to_record_batch().column("time").cast("int64").to_numpy() / 1e9
            np.testing.assert_allclose(time, log.time, atol=1e-9)
    assert static_parts > 20


def test_what_does_not_move_is_where_the_log_says(driven):
    folder, (log, _) = driven
    file = folder / FILES["none"]
    lines = {}
    for name in ("path/driven", "path/estimated", "reference/path"):
        (points,) = static(file, f"/run/{name}", "strips")
        lines[name] = np.array(points)[:, :2]
    np.testing.assert_allclose(lines["path/driven"], log.truth.pose[:, :2], atol=1e-6)
    np.testing.assert_allclose(lines["path/estimated"], log.pose[log.is_valid, :2], atol=1e-6)
    # of the circle, 8 s of which are 1.2 m
    chords = np.linalg.norm(np.diff(lines["reference/path"], axis=0), axis=1)
    assert chords.sum() == pytest.approx(1.2, rel=1e-3)

    posts = log.metadata["obstacles"]["posts"]
    centres = np.array(static(file, "/field/posts", "centers"))
    np.testing.assert_allclose(centres[:, :2], [(post["x"], post["y"]) for post in posts])
    radii = static(file, "/field/posts", "radii")
    np.testing.assert_allclose(radii, [post["radius"] for post in posts])
    heights = np.array(static(file, "/field/posts", "lengths"))
    np.testing.assert_allclose(centres[:, 2], heights / 2)  # they stand on the ground

    x, y, heading = log.scans.scan.mount
    (place,) = static(file, "/field/scanner", "translation")
    np.testing.assert_allclose(place[:2], [x, y])
    (turn,) = static(file, "/field/scanner", "quaternion")
    half = heading / 2
    np.testing.assert_allclose(turn, [0, 0, np.sin(half), np.cos(half)], atol=1e-7)


def test_errors_are_where_the_target_is_in_mm_and_degrees(driven):
    """As the robot sees it, ahead and to the left, and how far it turns away."""
    folder, (log, _) = driven
    file = folder / FILES["none"]
    _, target = component(file, "/run/reference/target", "translation")
    _, quaternion = component(file, "/run/reference/target", "quaternion")
    target_heading = 2 * np.arctan2(quaternion[:, 2], quaternion[:, 3])
    x, y, heading = log.truth.pose.T
    seen = (target[:, 0] - x + 1j * (target[:, 1] - y)) * np.exp(-1j * heading)
    _, position = component(file, "/run/error/position", "scalars")
    np.testing.assert_allclose(position @ [1, 1j], 1e3 * seen, atol=1e-3)
    _, distance = component(file, "/run/error/distance", "scalars")
    np.testing.assert_allclose(distance[:, 0], 1e3 * np.abs(seen), atol=1e-3)
    _, turned = component(file, "/run/error/heading", "scalars")
    turns = np.exp(1j * np.radians(turned[:, 0]))
    np.testing.assert_allclose(turns, np.exp(1j * (target_heading - heading)), atol=1e-6)
    assert static(file, "/run/error/position", "names") == ["ahead", "to the left"]
    assert static(file, "/run/slip/true", "names") == ["left, true", "right, true"]


def rows_of(file: Path, entity: str, name: str) -> list[list]:
    """The values (T,) of a component in each row."""
    rows = []
    for chunk in RrdReader(file).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        columns = [
            c for c in batch.schema.names if c.endswith(f":{name}") and "time" in batch.schema.names
        ]
        for column in columns:
            rows += zip(
                batch.column("time").to_pylist(), batch.column(column).to_pylist(), strict=True
            )
    return [values or [] for _, values in sorted(rows, key=lambda row: row[0])]


def test_scan_points_lie_on_the_plate(driven):
    folder, (log, _) = driven
    rows = rows_of(folder / FILES["none"], "/run/scan/plate", "positions")
    points = np.concatenate([row for row in rows if row])
    counts = [len(row) for row in rows]
    scan = np.repeat(np.arange(len(rows)), counts)
    off = Plate().outside(log.truth.pose, scan, points[:, 0], points[:, 1])
    assert len(off) > 1000
    assert np.abs(np.minimum(off, 0.02)).mean() < 0.01  # the noise is 5 mm
    assert (off < 0.05).mean() > 0.99


def test_the_estimated_plate_is_where_it_was_detected(driven):
    folder, (log, _) = driven
    rows = rows_of(folder / FILES["none"], "/run/estimate/plate", "centers")
    assert [len(row) for row in rows] == log.is_valid.astype(int).tolist()
    centres = np.concatenate([row for row in rows if row])
    np.testing.assert_allclose(centres[:, :2], log.pose[log.is_valid, :2], atol=1e-6)


def test_view_of_a_real_robots_log(driven, tmp_path, capsys):
    bare = [
        replace(log, truth=None, metadata={}, covariance=None, command=None, scans=None)
        for log in driven[1]
    ]
    write_csv(bare, tmp_path / "real.csv")
    file = tmp_path / "a real.rrd"
    main(["view", str(tmp_path / "real.csv"), "--save", str(file)])
    said = capsys.readouterr().out
    assert "2 runs; showing 'linear none'. --run NAME chooses one; repeat it to compare" in said
    assert f"to open it: rerun '{file}'" in said  # as a shell takes it
    _, translation = component(file, "/run/robot", "translation")
    seen = bare[0].is_valid
    np.testing.assert_allclose(translation[seen, :2], bare[0].pose[seen, :2], atol=1e-6)
    assert parameters_of(bare[0]) == RobotParameters()


def real_log(driven, **metadata) -> RunLog:
    """A run as the log of a real robot, of which only the metadata is known."""
    log = driven[1][1]
    return RunLog("real", log.time, log.omega, log.pose, metadata=metadata)


def entities_of(file: Path) -> set[str]:
    return {chunk.entity_path for chunk in RrdReader(file).stream()}


def test_true_and_measured_slips_have_colours_of_their_own(driven):
    colours = {}
    for line in series_of(Traces(driven[1][1])):
        if line.entity.startswith("slip/"):
            colours |= dict(zip(line.names, line.colours, strict=True))
    assert {"left, true", "right, true", "left, measured", "right, measured"} <= set(colours)
    assert len(set(colours.values())) == len(colours) == 6


def test_lines_of_errors_and_speeds_are_in_their_units(driven):
    """Positions in mm, headings in degrees, speeds in rad/s."""
    log = driven[1][1]
    traces = Traces(log)
    by_entity = {line.entity: line for line in series_of(traces)}
    error = traces.error
    position = by_entity["error/position"]
    assert position.names == ("ahead", "to the left")
    np.testing.assert_allclose(position.values, 1000 * error[:, :2])
    distance = by_entity["error/distance"].values
    np.testing.assert_allclose(distance[:, 0], 1000 * np.linalg.norm(error[:, :2], axis=1))
    heading = by_entity["error/heading"].values
    np.testing.assert_allclose(heading[:, 0], 180 / np.pi * error[:, 2])
    sprockets = by_entity["sprocket/measured"]
    assert sprockets.names == ("left, measured", "right, measured")
    np.testing.assert_array_equal(sprockets.values, log.omega)
    np.testing.assert_array_equal(by_entity["sprocket/command"].values, log.command)


def test_lines_of_soil_are_there_for_runs_in_soil(driven):
    log = driven[1][1]
    assert not any(line.entity.startswith("soil/") for line in series_of(Traces(log)))
    sinkage = np.full_like(log.omega, 0.012)
    resistance = np.full_like(log.omega, -3.0)
    truth = replace(log.truth, sinkage=sinkage, resistance=resistance)
    by_entity = {line.entity: line for line in series_of(Traces(replace(log, truth=truth)))}
    np.testing.assert_allclose(by_entity["soil/sinkage"].values, 12.0)  # [mm]
    np.testing.assert_allclose(by_entity["soil/resistance"].values, -3.0)  # [N]


def test_runs_without_a_reference_have_no_lines_of_errors(driven):
    lines = series_of(Traces(real_log(driven)))
    assert {line.entity for line in lines} >= {"sprocket/measured"}
    assert not any(line.entity.startswith("error/") for line in lines)


def test_a_real_robot_is_shown_in_its_size_and_without_a_plate(driven, tmp_path):
    geometry = {"half_gauge": 0.54, "sprocket_radius": 0.3}
    log = real_log(driven, geometry=geometry)
    parameters = parameters_of(log)
    assert (parameters.half_gauge, parameters.sprocket_radius) == (0.54, 0.3)
    assert parameters.axles[1] == pytest.approx(0.17 * 0.54 / 0.168)
    file = tmp_path / "sized.rrd"
    recording.record(file, [log])
    entities = entities_of(file)
    assert "/run/robot/chassis" in entities
    assert not any("plate" in entity for entity in entities)


def test_a_robot_of_unknown_size_is_an_arrow(driven, tmp_path):
    file = tmp_path / "unknown.rrd"
    recording.record(file, [real_log(driven)])
    robots = {entity for entity in entities_of(file) if entity.startswith("/run/robot")}
    assert robots == {"/run/robot"}


def test_view_shows_the_robot_that_is_named(driven, tmp_path, refused):
    log = tmp_path / "real.csv"
    write_csv([real_log(driven)], log)
    file = tmp_path / "named.rrd"
    assert "nobody" in refused("view", str(log), "--robot", "nobody", "--save", str(file))
    main(["view", str(log), "--robot", "husky", "--save", str(file)])
    wheels = {entity for entity in entities_of(file) if entity.endswith("_wheels/wheels")}
    assert wheels == {f"/run/robot/chassis/{side}_wheels/wheels" for side in ("left", "right")}


@pytest.mark.parametrize(
    ("odd", "missing"),
    [
        (
            {"geometry": {"half_gauge": "x", "sprocket_radius": {}}, "robot": {"mass": 10**400}},
            {"/run/slip"},
        ),
        (
            {
                "ground": {"patches": [None], "slope": "steep"},
                "obstacles": [3],
                "circle": {"radius": []},
            },
            {"/field/posts", "/run/error", "/run/reference"},
        ),
    ],
)
def test_parts_that_a_log_describes_otherwise_are_not_shown(driven, tmp_path, odd, missing):
    log = replace(driven[1][1], scans=None)
    file = tmp_path / "odd.rrd"
    described = file.with_name("described.rrd")
    recording.record(described, [log])
    recording.record(file, [replace(log, metadata=log.metadata | odd)])
    require_pose(file, "/run/robot/chassis", log)

    left_out = entities_of(described) - entities_of(file)
    assert {"/".join(entity.split("/")[:3]) for entity in left_out} == missing
    assert not any("patches" in entity for entity in entities_of(file))


def test_view_refuses(driven, refused, monkeypatch):
    folder = str(driven[0] / "none")
    for unknown in ("other", ""):
        assert refused("view", folder, "--run", unknown).endswith(
            f"no run {unknown!r}; there are 'linear none'"
        )
    assert "a file that ends in .rrd" in refused("view", folder, "--save", "x.txt")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    assert "doesn't start; try --web, or --save FILE" in refused("view", folder)


@pytest.mark.parametrize("size", [0, 20_000, 200_000])
def test_a_recording_that_does_not_fit_on_the_disk(size, driven, tmp_path, capfd):
    """As rerun writes to a file in a thread of its own, which hung."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    file = tmp_path / "run.rrd"
    log = driven[1][0]
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        with pytest.raises(OutputError, match=r"run\.rrd: can't be written \(File too large\)"):
            recording.record(file, [log])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr().err == ""


def test_a_recording_that_is_interrupted_prints_nothing(tmp_path, capfd):
    def send(stream):
        stream.rows("a", np.arange(3.0), rr.Scalars.columns(scalars=np.arange(3.0)))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_recording(tmp_path / "run.rrd", "title", send)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr().err == ""


def test_a_recording_is_valid(driven):
    file = driven[0] / FILES["none"]
    rerun = Path(sys.executable).with_name("rerun")
    done = subprocess.run([rerun, "rrd", "verify", file], capture_output=True, text=True)
    assert "verified without error" in done.stdout + done.stderr
