"""`trackslip coverage`, small; that intervals cover is tested in tests/trackslip/identification/test_comparison.py."""

import pytest

from trackslip.slip.families import FAMILIES

SMALL = ("--radii", "0.6", "1.2", "2.4", "--speeds", "0.1", "0.2", "--duration", "8", "--repeats", "40")


def test_every_parameter_of_every_law_has_its_share(trackslip):
    result = trackslip("coverage", *SMALL, "--run-repeats", "6", "--grids", "2", "--threads", "1")
    assert result.summary["repeats"] == 40
    for key in ("laws", "laws_errors_unknown"):
        laws = result.summary[key]
        assert set(laws) == {name for name in FAMILIES if FAMILIES[name].names} - {"icr_load"}
        for name, shares in laws.items():
            assert set(shares) == set(FAMILIES[name].names)
            assert all(0.6 < share <= 1 for share in shares.values())
    runs = result.summary["runs"]
    assert runs["repeats"] == 6
    assert set(runs["noise"]) == {"offset", "radius_error"}
    assert 0 < runs["bias_by_lean"]["offset"] < 1e-4
    assert "noise alone" in result.printed


@pytest.mark.slow
def test_drives_are_checked(trackslip):
    result = trackslip("coverage", "--drives", "--drive-repeats", "2", "--threads", "2")
    checks = result.summary["checks"]
    assert all(set(check) == {"name", "value", "expected", "bound", "unit", "holds", "source"} for check in checks)
    assert [check["value"] for check in checks if check["name"].endswith("fits without D or epsilon")] == [0.0] * 8
    errors = [check for check in checks if "rms error of offset" in check["name"]]
    assert len(errors) == 8
    assert all(check["unit"] == "m" and check["value"] < 0.005 for check in errors)
    assert result.summary["simulated"]["drives"] == 2
    assert "of the same speeds" in result.printed
