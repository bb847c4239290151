"""Recordings, read back and compared with the logs that they were made of."""

from __future__ import annotations

import socket
import subprocess
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from experiments import recording
from experiments.cli import main
from experiments.commands.view import choose, free_port, put_time
from experiments.recording.blueprint import blueprint
from experiments.recording.geometry import belt, body, looks, parameters_of
from experiments.recording.series import COMPARED, LEFT, PANELS, RIGHT, panels, readable, series_of
from experiments.recording.stream import telling_names
from experiments.recording.traces import traces_of
from experiments.storage.plain_json import plain
from sim.ground.ground import Ground, Patch
from sim.robot.parameters import RobotParameters
from trackslip.errors import LogError
from trackslip.kinematics import RobotGeometry, limit_sprocket_speeds, track_slip
from trackslip.localization.scan import Plate
from trackslip.logs.logfile import read_runs, write_csv
from trackslip.logs.runlog import RunLog
from trackslip.slip.exponential import ExponentialSpeed

CIRCLE = (
    *("--reference", "circle", "--circle-duration", "14", "--circle-radius", "0.8"),
    *("--start", "-1.4", "0.1", "0.2"),
)


@pytest.fixture(scope="module")
def driven(tmp_path_factory) -> tuple[Path, list[RunLog]]:
    """Two runs on a circle among posts, whose folders hold a recording each."""
    logs, folder = [], tmp_path_factory.mktemp("recording")
    for compensation in ("none", "icr_radius"):
        out = folder / compensation
        main(["track", *CIRCLE, "--compensation", compensation, "--obstacles", "posts", "--rrd", "--out", str(out)])
        logs += read_runs(out / "runs.parquet")
    return folder, logs


def component(file: Path, entity: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times (T,) [s] and values (T, n) of a component of an entity that has as many in each row."""
    times, values = [], []
    for chunk in RrdReader(file).stream().filter(content=entity):
        batch = chunk.to_record_batch()
        column = [c for c in batch.schema.names if c.endswith(f":{name}")]
        if column and "time" in batch.schema.names:
            flat = batch.column(column[0]).flatten()
            while pa.types.is_nested(flat.type):
                flat = flat.flatten()
            values.append(np.asarray(flat).reshape(batch.num_rows, -1))
            times.append(batch.column("time").cast("int64").to_numpy() / 1e9)
    order = np.argsort(np.concatenate(times))
    return np.concatenate(times)[order], np.concatenate(values)[order]


def verify(file: Path) -> None:
    command = [str(Path(sys.executable).with_name("rerun")), "rrd", "verify", str(file)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def require_pose(file: Path, entity: str, log: RunLog) -> None:
    assert log.truth is not None
    time, translation = component(file, entity, "translation")
    _, quaternion = component(file, entity, "quaternion")
    np.testing.assert_allclose(time, log.time, atol=1e-9)
    np.testing.assert_allclose(translation[:, :2], log.truth.pose[:, :2], atol=1e-6)
    x, y, z, w = quaternion.T.astype(float)  # rerun's order
    np.testing.assert_allclose([x, y], 0, atol=1e-7)
    heading = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    assert np.ptp(log.truth.pose[:, 2]) > 1  # the robot turned
    np.testing.assert_allclose(heading - heading[0], log.truth.pose[:, 2] - log.truth.pose[0, 2], atol=1e-6)
    np.testing.assert_allclose(np.exp(1j * heading), np.exp(1j * log.truth.pose[:, 2]), atol=1e-6)


def test_recording_holds_the_run(driven):
    folder, logs = driven
    log = logs[1]
    file = folder / "icr_radius" / "recordings" / "linear_icr_radius.rrd"
    verify(file)
    assert file.stat().st_size < 3e6
    require_pose(file, "/run/robot", log)
    _, slip = component(file, "/run/slip/true", "scalars")
    geometry = RobotGeometry(**log.metadata["geometry"])
    twist = log.truth.twist[:, [0, 2]]
    expected = track_slip(log.omega[1:], (twist[1:] + twist[:-1]) / 2, geometry)
    turning = np.abs(log.omega[1:]) > 0.3
    np.testing.assert_allclose(slip[1:][turning], expected[turning], atol=1e-12)
    assert np.isnan(slip[1:][~turning]).all()
    _, measured = component(file, "/run/sprocket/measured", "scalars")
    np.testing.assert_array_equal(measured, log.omega)
    _, force = component(file, "/run/robot/contact_forces", "vectors")
    scale = force.reshape(len(force), -1, 3)[:, :, 2].sum(axis=1) / log.truth.contact[..., 2].sum(axis=1)
    np.testing.assert_allclose(scale, scale[0], rtol=1e-5)


def test_slips_agree_in_steady_turns(driven):
    traces = traces_of(driven[1][1])
    steady = slice(160, 260)
    for other in (traces.identified, traces.law):
        np.testing.assert_allclose(np.nanmean(other[steady], axis=0), traces.slip[steady].mean(axis=0), atol=0.01)
    assert traces.law_name == "icr_radius"
    assert traces.moment > 11.9
    assert traces.distance[0] == pytest.approx(np.hypot(0.1, 0.1), abs=1e-6)  # the circle is the one that was asked for


def has_labels(low: float, high: float) -> bool:
    """Whether an axis of the viewer's has two labels or more, but not more than there is room for."""
    powers = 10.0 ** np.arange(-5, 5)
    count = np.floor(high / powers) - np.ceil(low / powers) + 1
    return bool(((count >= 2) & (count <= 5)).any())


def lengths(file: Path, entity: str, name: str) -> np.ndarray:
    """How many (T,) there are of a component in each row."""
    batches = [chunk.to_record_batch() for chunk in RrdReader(file).stream().filter(content=entity)]
    columns = [(b, c) for b in batches for c in b.schema.names if c.endswith(f":{name}") and "time" in b.schema.names]
    rows = [
        pair for b, c in columns for pair in zip(b.column("time").to_pylist(), b.column(c).to_pylist(), strict=True)
    ]
    return np.array([len(values or ()) for _, values in sorted(rows, key=lambda row: row[0])])


def test_nothing_is_the_plates_where_it_was_not_found(driven, tmp_path):
    log = driven[1][0]
    missed = np.isin(np.arange(len(log.time)), (50, 51, 120))
    log = replace(log, valid=log.is_valid & ~missed)
    recording.record(tmp_path / "run.rrd", [log])
    verify(tmp_path / "run.rrd")
    for entity, name in (("estimate/plate", "half_sizes"), ("estimate/covariance", "half_sizes")):
        np.testing.assert_array_equal(lengths(tmp_path / "run.rrd", f"/run/{entity}", name), log.is_valid)
    for entity, name in (("scan/plate", "positions"), ("scan/rays", "strips")):
        np.testing.assert_array_equal(lengths(tmp_path / "run.rrd", f"/run/{entity}", name) > 0, log.is_valid)
    others = lengths(tmp_path / "run.rrd", "/run/scan/other", "positions")
    assert (others[[50, 51, 120]] > others[[49, 52, 119]]).all()  # what else came back there


def test_scan_points_lie_on_the_plate(driven):
    """In the world, though the scanner stands elsewhere, looking another way."""
    file = driven[0] / "none" / "recordings" / "linear_none.rrd"
    log, plate = driven[1][0], Plate()
    count = lengths(file, "/run/scan/plate", "positions")
    points = np.concatenate([
        np.asarray(chunk.to_record_batch().column("Points3D:positions").flatten().flatten()).reshape(-1, 3)
        for chunk in RrdReader(file).stream().filter(content="/run/scan/plate")
        if "time" in chunk.to_record_batch().schema.names
    ])  # fmt: skip
    off = plate.outside(np.repeat(log.truth.pose, count, axis=0), points[:, 0], points[:, 1])
    assert len(off) > 1000
    assert np.abs(np.minimum(off, 0.02)).mean() < 0.01  # the noise is 5 mm
    assert (off < 0.05).mean() > 0.99


def test_patches_and_slope_are_shown(driven, tmp_path):
    ground = Ground(slope=0.1, uphill=1.2, patches=(Patch((0.0, np.inf), (-1.0, 0.5), 0.1, 0.2),))
    log = replace(driven[1][0], metadata=driven[1][0].metadata | {"ground": plain(ground)})
    recording.record(tmp_path / "run.rrd", [log])
    verify(tmp_path / "run.rrd")
    found = {}
    for chunk in RrdReader(tmp_path / "run.rrd").stream():
        batch = chunk.to_record_batch()
        found |= {f"{chunk.entity_path} {name}": batch.column(name).to_pylist()[0] for name in batch.schema.names}
    centre, half = found["/field/patches Boxes3D:centers"][0], found["/field/patches Boxes3D:half_sizes"][0]
    np.testing.assert_allclose([centre[0] - half[0], centre[1] - half[1], centre[1] + half[1]], [0, -1, 0.5], atol=1e-6)
    assert 1 < half[0] < 10  # to where the ground ends
    assert found["/field/patches Boxes3D:labels"] == ["friction 0.1 along, 0.2 across"]
    np.testing.assert_allclose(found["/field/uphill Arrows3D:vectors"], [[np.cos(1.2), np.sin(1.2), 0]], atol=1e-6)
    assert found["/field/uphill Arrows3D:labels"] == ["uphill, 0.1 rad"]


def test_the_law_shown_is_the_one_that_compensated(driven):
    """Also one from another file than the shipped, and one that knows of speed."""
    log = driven[1][0]
    geometry = RobotGeometry(**log.metadata["geometry"])
    law = ExponentialSpeed(0.12, -0.9, -0.3, -1.1, gamma_outer=0.2, gamma_inner=-0.3)
    limit = log.metadata["drive"]["top_speed"] / geometry.sprocket_radius
    command = limit_sprocket_speeds(law.sprocket_speeds(log.twist_command, geometry), limit)
    traces = traces_of(replace(log, command=command, metadata=log.metadata | {"compensation": "exponential"}))
    slip = law.slip(log.twist_command)
    shown = np.isfinite(traces.law)
    assert shown.mean() > 0.8
    np.testing.assert_allclose(traces.law[shown], slip[shown], atol=1e-9)
    assert not shown[np.abs(command).max(axis=1) >= limit].any()  # scaled down: it can't be told there
    assert traces.law_name == "exponential"


def test_slips_are_on_their_axis(driven):
    traces = traces_of(driven[1][1])
    slip = {panel.title: panel.range for panel in panels([traces]) if "lip" in panel.title}
    assert slip == {"Slip [-]": (-0.25, 0.20)}
    more = replace(traces, slip=np.tile([-0.7, 0.3], (len(traces.time), 1)))
    for runs in ([more], [traces, more]):
        ranges = [panel.range for panel in panels(runs) if "lip" in panel.title]
        assert all(low < -0.7 and high > 0.3 for low, high in ranges)


def test_axes_hold_what_they_show_and_can_be_read(driven):
    log = driven[1][1]
    wild = replace(log, command=log.command + np.array([-6.0, 0.0]))
    for runs in ([log], [wild], [log, wild]):
        traces = [traces_of(run) for run in runs]
        shown = {panel.title.split(" [")[0]: panel.range for panel in panels(traces)}
        low, high = shown["Sprocket speed"]
        for run in runs:
            speeds = run.omega if len(runs) > 1 else np.append(run.omega, run.command)
            assert low < speeds.min() <= speeds.max() < high
        assert all(has_labels(*shown[name]) for name in shown if "lip" not in name)


def test_runs_side_by_side(driven, tmp_path):
    logs = driven[1]
    file = tmp_path / "both.rrd"
    recording.record(file, logs)
    verify(file)
    for log in logs:
        require_pose(file, f"/run/{log.run.replace(' ', chr(92) + ' ')}/robot", log)
    assert len(RrdReader(file).recordings()) == 1
    assert len(RrdReader(file).blueprints()) == 1


def test_detail_is_stored_and_changes_nothing(driven, tmp_path):
    logs = driven[1]
    main(["track", *CIRCLE, "--compensation", "none", "--obstacles", "posts", "--out", str(tmp_path)])
    plain, log = read_runs(tmp_path / "runs.parquet")[0], logs[0]
    assert not (tmp_path / "recordings").exists()
    assert plain.truth.contact is None
    assert plain.scans is None
    np.testing.assert_array_equal(log.truth.pose, plain.truth.pose)
    assert log.metadata == plain.metadata
    sides = log.truth.contact.reshape(len(log.time), 2, -1, 3).sum(axis=2)
    np.testing.assert_allclose(sides[..., 0], log.truth.traction, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(sides[1:, :, 2].sum(axis=1), 25 * 9.81, rtol=0.01)
    first = log.scans.first_beam()
    k = 100
    width = log.scans.cluster.width[k]
    seen = log.scans.full[k, first[k] : first[k] + width]
    hit = log.scans.cluster.hit[k, :width]
    np.testing.assert_array_equal(seen[hit], log.scans.cluster.range[k, :width][hit].astype(np.float32))
    assert np.isfinite(log.scans.full[k]).sum() > hit.sum()  # the posts


def test_shoes_run_with_the_belt():
    model = looks(RobotParameters())
    band, shoes = belt(model, "left_belt")
    assert shoes is not None
    assert len(shoes.place) == 44
    assert len(band.vertices) + 44 * len(shoes.shoe) == 3 * 936
    assert shoes.pitch == pytest.approx((0.8 + 2 * np.pi * 0.067) / 44, rel=0.01)
    place, turn = shoes.shoes(np.array([0.0, 0.01, shoes.pitch]))
    below = place[0, :, 2] < 0.01
    forwards = np.zeros_like(below)
    forwards[1:-1] = place[1, 1:-1, 0] > place[0, 1:-1, 0]
    assert not forwards[below].any()  # under the robot the belt runs backwards
    np.testing.assert_allclose(place[2], np.roll(place[0], -1, axis=0), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(turn, axis=-1), 1)
    _, above = np.unravel_index(np.argmax(place[..., 2]), place.shape[:2])
    np.testing.assert_allclose(np.abs(turn[0, above]), [0, 1, 0, 0], atol=0.1)  # upside down


def test_triangles_face_outwards():
    plate = body(looks(RobotParameters()), "chassis", without=("left_belt", "right_belt"))
    assert np.isfinite(plate.normals).all()
    mesh = plate.vertices.reshape(-1, 3, 3)
    volume = np.einsum("ni,ni->n", mesh[:, 0], np.cross(mesh[:, 1], mesh[:, 2])).sum() / 6
    assert volume > 0.60 * 0.04 * 0.20  # that of the plate and more: of outward faces


def test_view_of_a_real_robots_log(driven, tmp_path, capsys):
    bare = [replace(log, truth=None, metadata={}, covariance=None, command=None, scans=None) for log in driven[1]]
    write_csv(bare, tmp_path / "real.csv")
    file = tmp_path / "a real.rrd"
    main(["view", str(tmp_path / "real.csv"), "--save", str(file)])
    said = capsys.readouterr().out
    assert "2 runs, shown is 'linear none'" in said
    assert f"; rerun '{file}'" in said  # as a shell takes it
    verify(file)
    _, translation = component(file, "/run/robot", "translation")
    np.testing.assert_allclose(translation[:, :2], bare[0].pose[:, :2], atol=1e-6)
    assert parameters_of(bare[0]) == RobotParameters()


def test_view_refuses(driven, refused):
    folder = driven[0] / "none"
    assert refused("view", str(folder), "--run", "other").endswith("no run 'other'; there are 'linear none'")
    assert "there is no runs.parquet in this folder" in refused("view", str(driven[0]))
    assert "no such file" in refused("view", "missing.parquet")
    assert "a file that ends in .rrd" in refused("view", str(folder), "--save", "x.txt")
    assert "can't be written" in refused("view", str(folder), "--save", "/proc/x/y.rrd")


def test_view_chooses_by_name_or_id(driven):
    ids = ("abcd12", "abce34")
    logs = [replace(log, metadata=log.metadata | {"id": i}) for log, i in zip(driven[1], ids, strict=True)]
    path = Path("runs")
    assert choose(logs, ["abce34", "linear none"], path) == [logs[1], logs[0]]
    assert choose(logs, ["abcd"], path) == [logs[0]]
    with pytest.raises(LogError, match=r"2 runs whose id begins with 'abc'; there are 'linear none' \(id abcd12\), "):
        choose(logs, ["abc"], path)
    for unknown in ("abcx", ""):
        with pytest.raises(LogError, match="no run '"):
            choose(logs, [unknown], path)
    with pytest.raises(LogError, match="are the same"):
        choose(logs, ["abcd", "linear none"], path)


def test_runs_without_a_reference_have_a_legend(driven, monkeypatch):
    shown = []
    view = rrb.TimeSeriesView
    monkeypatch.setattr(rrb, "TimeSeriesView", lambda **about: shown.append(about) or view(**about))
    sent = [f"{root}/slip/{name}" for root in ("run/a", "run/b") for name in ("true", "identified")]
    blueprint(["run/a", "run/b"], COMPARED, sent, np.zeros((1, 2)), 1.0, 6.0)
    assert [about["name"].split()[0] for about in shown] == ["True", "Identified"]
    visible = [about["plot_legend"].visible.as_arrow_array()[0].as_py() for about in shown]
    assert visible == [True, False]


def test_a_taken_port_is_left_alone():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = other.getsockname()[1]
        assert free_port(taken) != taken
    assert free_port(taken) == taken


def test_lines_lie_on_thicker_ones(driven):
    """The viewer draws by the alphabet."""
    series = {line.entity: line for line in series_of(traces_of(driven[1][1]))}
    for panel in PANELS:
        widths = [series[entity].width for entity in sorted(panel.entities)]
        assert max(widths) == widths[0]
    for entity, line in series.items():
        if entity.endswith(("true", "measured", "load", "traction")) and line.names[0].startswith("left"):
            assert line.colours == (LEFT, RIGHT)
        elif line.names[0].startswith("left"):
            assert not set(line.colours) & {LEFT, RIGHT}


@pytest.mark.parametrize("values", [(-40.0, 50.0), (0.2, 11.9), (-0.7, 0.99), (-5.0, -0.1), (0.0, 0.0), (0.0, 1420.0)])
def test_errors_axes_have_two_labels_or_more(values):
    low, high = readable(np.array(values))
    assert low < min(values) <= max(values) < high
    assert has_labels(low, high)


def test_view_without_a_viewer(driven, refused, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    assert "doesn't start; try --web, or --save FILE" in refused("view", str(driven[0] / "none"))


def test_recordings_are_replaced_whole(driven, trackslip):
    quick = ("--reference", "circle", "--circle-duration", "1", "--localization", "truth")
    first = trackslip("track", *quick, "--rrd", "--compensation", "none")
    assert [file.name for file in (first.folder / "recordings").iterdir()] == ["linear_none.rrd"]
    verify(first.folder / "recordings" / "linear_none.rrd")
    again = trackslip("track", *quick, "--rrd", "--compensation", "published")
    assert [file.name for file in (again.folder / "recordings").iterdir()] == ["linear_published.rrd"]
    without = trackslip("track", *quick)
    assert not (without.folder / "recordings").exists()


def test_file_names():
    assert recording.file_names(["radius=0.5 speed=0.1", "a/b", "a b", "..", "x" * 300]) == [
        "radius=0.5_speed=0.1.rrd",
        "a_b.rrd",
        "a_b_2.rrd",
        "run.rrd",
        "x" * 120 + ".rrd",
    ]


def test_driving_without_a_recording_needs_no_rerun():
    code = "import sys, experiments.commands.track, experiments.commands.view; sys.exit('rerun' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_names_that_tell_runs_apart():
    assert telling_names(["linear none stone 0", "linear icr stone 0"]) == ["none", "icr"]
    assert telling_names(["a b", "a b c"]) == ["a b", "a b c"]


def test_the_native_viewer_is_put_to_the_interesting_moment(driven, tmp_path, monkeypatch):
    """As soon as it listens and has opened the recording; not if it has ended before."""
    begin = recording.record(tmp_path / "run.rrd", driven[1][:1])
    assert 0 < begin < 14
    asked, put = [], []

    class Viewer:
        def poll(self):
            return 1 if len(asked) > 5 else None

        @staticmethod
        def connect(_stream):
            asked.append(1)
            if len(asked) == 1:
                raise ConnectionError
            return Viewer()

        def get_state(self):
            return types.SimpleNamespace(recordings=["run"] if len(asked) == 3 else [])

        def set_time(self, duration):
            put.append(duration)

    monkeypatch.setattr("rerun.experimental.ViewerClient", Viewer)
    put_time("there", begin, Viewer())
    assert (len(asked), put) == (3, [begin])
    put_time("there", begin, Viewer())
    assert (len(asked), put) == (6, [begin])
