"""`trackslip coverage`, small; that intervals cover is tested in tests/trackslip/test_comparison.py."""

import pytest

from trackslip.slip.families import FAMILIES

SMALL = ("--radii", "0.6", "1.2", "2.4", "--speeds", "0.1", "0.2", "--duration", "8", "--repeats", "40")


def test_every_parameter_of_every_law_has_its_share(trackslip):
    result = trackslip("coverage", *SMALL, "--run-repeats", "6", "--drives", "2")
    assert result.summary["repeats"] == 40
    for key in ("laws", "laws_errors_unknown"):
        laws = result.summary[key]
        assert set(laws) == {name for name in FAMILIES if FAMILIES[name].names}
        for name, shares in laws.items():
            assert set(shares) == set(FAMILIES[name].names)
            assert all(0.6 < share <= 1 for share in shares.values())
    runs = result.summary["runs"]
    assert runs["repeats"] == 6
    assert set(runs["noise"]) == {"offset", "radius_error"}
    assert 0 < runs["bias_by_lean"]["offset"] < 1e-4
    assert "noise alone" in result.printed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--repeats", "0"), "repeats = 0"),
        (("--run-repeats", "4", "--drives", "5"), "drives = 5: must be an integer from 1 to run_repeats = 4"),
        (("--scanner.noise", "0"), "scanner.noise = 0"),
        (("--radii", "0.6"), "radii = (0.6,): must be at least two"),
    ],
)
def test_mistakes(refused, arguments, message):
    assert message in refused("coverage", *arguments)
