"""`trackslip track`: one run in closed loop."""

import numpy as np
import pytest

from trackslip.logs.logfile import read_runs

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")


@pytest.mark.parametrize("controller", ["feedforward", "linear"])
@pytest.mark.parametrize("localization", ["plate", "line", "truth"])
def test_track(trackslip, controller, localization):
    options = ("--controller", controller, "--compensation", "icr", "--localization", localization)
    circle = ("--reference", "circle", "--circle-duration", "14", "--circle-radius", "1.0")
    result = trackslip("track", *options, *circle)
    (row,) = result.summary["tracking"]
    assert (row["controller"], row["compensation"], row["localization"]) == (controller, "icr", localization)
    assert row["rms_position"] < 0.05
    assert row["rms_position_after_12s"] > 0


def test_track_takes_a_start_and_laws(trackslip):
    identified = trackslip("identify", str(trackslip("grid", *SMALL).folder)).folder
    result = trackslip(
        "track", "--reference", "circle", "--circle-duration", "6", "--start", "-1.5", "0.2", "0.0",
        "--compensation", "exponential", "--laws", str(identified),
    )  # fmt: skip
    log = read_runs(result.folder / "runs.parquet")[0]
    np.testing.assert_allclose(log.truth.pose[0], [-1.5, 0.2, 0.0], atol=1e-9)
    assert result.manifest["config"]["start"] == [-1.5, 0.2, 0.0]
