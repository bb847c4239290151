"""`--obstacles` and the scanner's errors on the command line."""

import pytest

SMALL = ("--radii", "1.0", "--speeds", "0.2", "--duration", "6")


def test_a_grid_among_posts_remembers_them(trackslip):
    found = trackslip("grid", *SMALL, "--obstacles", "posts", "--scanner.quantisation", "0.01")
    assert len(found.manifest["obstacles"]["posts"]) == 5
    assert found.manifest["obstacles"]["walls"] == []
    assert found.manifest["config"]["obstacles"] == "posts"
    assert found.manifest["config"]["scanner"]["quantisation"] == 0.01
    assert found.summary["localization"]["valid_fraction"] > 0.5


def test_closed_loop_with_walls_from_a_file(trackslip, tmp_path):
    path = tmp_path / "field.toml"
    path.write_text("[[walls]]\nx0 = -9\ny0 = 9\nx1 = 9\ny1 = 9\n")
    circle = ("--reference", "circle", "--circle-duration", "5")
    found = trackslip("track", *circle, "--obstacles", str(path), "--scanner.scan-duration", "0.0133")
    assert found.manifest["obstacles"]["walls"] == [{"x0": -9.0, "y0": 9.0, "x1": 9.0, "y1": 9.0}]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--obstacles", "forest"), "obstacles = 'forest': must be one of posts"),
        (("--obstacles", "nowhere.toml"), "nowhere.toml: No such file"),
        (("--scanner.scan-duration", "0.06"), "scanner.scan_duration = 0.06: must be at most 0.05 s"),
        (("--scanner.quantisation", "-1"), "scanner.quantisation = -1.0: must be a finite number >= 0"),
        (("--scanner.divergence", "1"), "scanner.divergence = 1.0: must be at most 0.1 rad"),
        (("--scanner.range-bias", "nan"), "scanner.range_bias = nan: must be from -0.5 to 0.5 m"),
    ],
)
def test_mistakes_get_one_line(refused, arguments, message):
    assert message in refused("grid", *SMALL, *arguments)
