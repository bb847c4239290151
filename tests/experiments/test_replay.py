"""`trackslip replay`: simulated drives, driven again."""

import numpy as np
import pytest
from command_runs import ran

import trackslip


@pytest.fixture(scope="module")
def wander(tmp_path_factory):
    """Two teleoperated drives of 12 s."""
    return ran(tmp_path_factory.mktemp("wander") / "out", "wander", "--drives", "2", "--duration", "12").folder


def test_simulated_drives_come_back(wander, tmp_path):
    result = ran(tmp_path / "out", "replay", str(wander), "--rrd")
    ahead = {label: one["after_seconds"]["5"]["position"]["rms"] for label, one in result.summary["models"].items()}
    assert ahead["simulated"] < 0.06  # the poses' own noise
    assert ahead["simulated"] < 0.6 * ahead["no slip"]
    measured, simulated = trackslip.load(wander), trackslip.load(result.folder)
    assert [log.run for log in simulated] == [log.run for log in measured]
    for ours, theirs in zip(simulated, measured, strict=True):
        np.testing.assert_allclose(ours.omega, theirs.omega)
    assert (result.folder / "report.html").exists()
    assert len(list((result.folder / "recordings").glob("*.rrd"))) == 2
    assert "simulated, after" in result.printed


def test_another_ground_fits_worse(wander, tmp_path):
    def missed(*options):
        found = ran(tmp_path / "-".join(options or "a"), "replay", str(wander), *options).summary
        return found["models"]["simulated"]["after_seconds"]["5"]["heading"]["rms"]

    assert missed("--ground.across", "1.4") > 1.5 * missed()


def test_options_change_single_fields_of_the_drive(wander, refused, tmp_path):
    slow = tmp_path / "slow.toml"
    slow.write_text("radius_error = 0.0066\n[drive]\nlag = 0.3\n")
    options = ("replay", str(wander), "--robot", str(slow), "--drive.delay", "0.2")
    result = ran(tmp_path / "out", *options, "--inputs", "commands")
    drive = result.manifest["robot"]["drive"]
    assert (drive["lag"], drive["delay"], drive["top_speed"]) == (0.3, 0.2, 0.3)
    assert result.summary["models"]["simulated"]["after_seconds"]["5"]["position"]["rms"] > 0.06  # driven without them
    assert " model " in result.printed
    assert "drive.delay = 0.2: must be left out without --inputs commands" in refused(*options)
