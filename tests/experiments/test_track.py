import json

import numpy as np
import pytest

from experiments.cli import main
from trackslip.kinematics import RobotGeometry
from trackslip.laws.file import save_laws
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.logfile import read_runs

CIRCLE = ("--reference", "circle", "--circle-duration", "6")
STUBBORN = """
import numpy as np

class Stubborn:
    def reset(self): pass
    def twist(self, time, pose, reference):
        if time > 2.0:
            raise SystemExit("I have had enough")
        return np.tile(reference.twist(time), (len(pose), 1))
"""


@pytest.mark.parametrize(
    ("controller", "localization"),
    [("linear", "plate"), ("feedforward", "line"), ("feedforward", "truth")],
)
def test_track(trackslip, controller, localization):
    options = ("--controller", controller, "--compensation", "icr", "--localization", localization)
    result = trackslip(
        "track",
        *options,
        "--reference",
        "circle",
        "--circle-duration",
        "14",
        "--circle-radius",
        "1.0",
    )
    (row,) = result.summary["tracking"]
    assert (row["controller"], row["compensation"], row["localization"]) == (
        controller,
        "icr",
        localization,
    )
    assert row["rms_position"] < 0.05


def test_track_takes_a_start_and_laws(trackslip, tmp_path):
    geometry = RobotGeometry(half_gauge=0.168, sprocket_radius=0.06)
    offset = 0.1
    laws = tmp_path / "mine.json"
    save_laws(laws, {"icr_radius": ConstantIcr(offset, 0.168)}, geometry)
    start = ("--start", "-1.5", "0.2", "0.0")
    compensation = ("--compensation", "icr_radius", "--laws", str(laws))
    result = trackslip("track", *CIRCLE, *start, *compensation)
    (log,) = read_runs(result.folder / "runs.parquet")
    np.testing.assert_allclose(log.truth.pose[0], [-1.5, 0.2, 0.0], atol=1e-9)
    v, w = log.twist_command[100]
    left = v - (0.168 + offset) * w
    right = v + (0.168 + offset) * w
    np.testing.assert_allclose(log.command[100], [left / 0.06, right / 0.06], rtol=1e-9)


def test_a_controller_that_raises_leaves_its_run(tmp_path, capsys, monkeypatch):
    (tmp_path / "stubborn_driver.py").write_text(STUBBORN)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(["track", "--controller", "stubborn_driver:Stubborn", *CIRCLE, "--out", "out"])
    line = capsys.readouterr().err.strip().splitlines()[-1]  # progress may come before
    assert stop.value.code == 2
    assert "its controller fails at 2.05 s (SystemExit: I have had enough)" in line
    (log,) = read_runs(tmp_path / "out" / "runs.parquet")
    assert (
        log.metadata["failure"]
        == json.loads((tmp_path / "out" / "manifest.json").read_text())["error"]
    )
    assert 1.9 < log.time[-1] <= 2.05


DITHERING = """
import numpy as np

class Dithering:
    def reset(self, seed):
        self.generators = [np.random.default_rng(one) for one in seed]

    def twist(self, time, pose, reference):
        noise = [0.1 * generator.standard_normal() for generator in self.generators]
        return reference.twist(time) + np.column_stack([np.zeros(len(pose)), noise])
"""


def test_a_random_controller_depends_on_the_seed(trackslip, tmp_path, monkeypatch):
    (tmp_path / "dithering_driver.py").write_text(DITHERING)
    monkeypatch.chdir(tmp_path)
    options = ("--controller", "dithering_driver:Dithering", "--localization", "truth")
    twists = []
    for seed in ("1", "1", "2"):
        result = trackslip("track", *CIRCLE, *options, "--seed", seed)
        (log,) = read_runs(result.folder / "runs.parquet")
        twists.append(log.twist_command)
    np.testing.assert_array_equal(twists[0], twists[1])
    assert np.abs(twists[2] - twists[0]).max() > 0.05


@pytest.mark.usefixtures("with_figures")
def test_the_page_has_path_errors_and_slip(trackslip):
    result = trackslip("track", *CIRCLE, "--localization", "truth")
    page = (result.folder / "report.html").read_text(encoding="utf-8")
    (row,) = result.summary["tracking"]
    millimetres = f"{1e3 * row['rms_position']:.1f} mm rms from the reference"
    assert f"<h2>{millimetres}</h2>" in page  # the circle is shorter than 12 s
    assert page.count('<div class="zoom">') == 3
    figures = {file.stem for file in (result.folder / "figures").glob("*.svg")}
    assert figures == {"path_and_errors_path", "path_and_errors_errors", "slip"}


def test_a_run_that_leaves_its_reference_is_an_alarm(trackslip):
    start = ("--start", "0", "1", "0", "--controller", "feedforward")
    result = trackslip("track", *CIRCLE, "--localization", "truth", *start)
    page = (result.folder / "report.html").read_text(encoding="utf-8")
    assert '<section class="answer alarm">\n<h2>The robot left the reference, by up to' in page
