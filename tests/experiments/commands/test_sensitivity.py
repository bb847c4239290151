"""`trackslip sensitivity`: its rows and its table."""

import pytest

from experiments.studies.sensitivity import DISTURBANCES

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.2", "--duration", "8")


def test_a_row_for_each_disturbance(trackslip):
    found = trackslip("sensitivity", *SMALL, "--seed", "2")
    assert {path.name for path in found.folder.iterdir()} == {"manifest.json", "summary.json"}
    rows = {row["effect"]: row for row in found.summary["rows"]}
    assert list(rows) == [effect.name for effect in DISTURBANCES]
    for name, row in rows.items():
        assert name in found.printed
        assert f"{row['slip_error']['outer']['bias']:+.5f}" in found.printed
        assert row["runs"]["all"] == 2
    nominal, noisy = rows["nominal"], rows["noise 10 mm"]
    assert nominal["settings"] == {}
    assert nominal["localization"]["valid_fraction"] > 0.95
    for track in ("outer", "inner"):
        assert nominal["slip_error"][track]["largest"] < 0.002
        # a clock that is 0.1 % wrong makes slip wrong by as much; it also shifts the steady window by a scan
        bias = rows["clock 0.1 % fast"]["slip_error"][track]["bias"] - nominal["slip_error"][track]["bias"]
        assert bias == pytest.approx(0.001, abs=0.0003)
    assert noisy["settings"] == {"noise": 0.01}
    for error in ("rmse_x", "rmse_y", "rmse_heading"):
        assert noisy["localization"][error] > nominal["localization"][error]
    biased = rows["range bias 10 mm"]["localization"]["rmse_y"]  # the scanner looks along y
    assert biased == pytest.approx(0.01, abs=0.004)
