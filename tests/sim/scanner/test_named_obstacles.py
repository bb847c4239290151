import re

import numpy as np
import pytest
from pages import ROOT, file

from sim.scanner.obstacles import NAMED_OBSTACLES, Obstacles, Post, Walker, Wall, load_obstacles
from trackslip.errors import InvalidValueError, SettingsFileError

PAGE = ROOT / "docs" / "grounds_and_robots.md"
TEXT = """
[[posts]]
x = 1
y = 2.0

[[walls]]
x0 = 0.0
y0 = 0.0
x1 = 1.0
y1 = 0.0

[[walkers]]
x = 0.0
y = 5.0
vx = 1.2
vy = 0.0
turns_after = 3.0
"""


def test_a_file_holds_all_kinds(tmp_path):
    path = tmp_path / "field.toml"
    path.write_text(TEXT)
    expected = Obstacles((Post(1.0, 2.0),), (Wall(0.0, 0.0, 1.0, 0.0),), (Walker(0.0, 5.0, 1.2, 0.0, turns_after=3.0),))
    assert load_obstacles(str(path)) == expected


def test_the_example_on_the_page_is_a_file(tmp_path):
    path = tmp_path / "obstacles.toml"
    path.write_text(file(PAGE, "obstacles.toml"))
    found = load_obstacles(str(path))
    assert (len(found.posts), len(found.walls), len(found.walkers)) == (1, 1, 1)
    assert found.walkers == NAMED_OBSTACLES["walker"].walkers


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[posts]]\nx = 1.0", "posts[0]: y is missing"),
        ("[[posts]]\nx = 1.0\ny = 0\nradius = -1", "posts[0]: radius = -1.0: must be"),
        ("[[trees]]\nx = 1.0", "trees is unknown; known are posts, walls, walkers"),
        ("walls = 3", "walls = 3: must be a list"),
    ],
)
def test_mistakes_name_file_and_field(tmp_path, text, message):
    path = tmp_path / "field.toml"
    path.write_text(text)
    with pytest.raises(SettingsFileError, match=re.escape(f"{path}: {message}")):
        load_obstacles(str(path))


def test_other_names_are_refused():
    for source in ("forest", ""):
        with pytest.raises(InvalidValueError, match="one of posts, room, walker, occluded, or"):
            load_obstacles(source)


@pytest.mark.parametrize("name", sorted(NAMED_OBSTACLES))
def test_named_obstacles_leave_the_circles_free(name):
    """Of the grid's circles, all tangent at (-1.5, 0), with room for a robot and its plate."""
    angle = np.linspace(0.0, 2 * np.pi, 400)
    circles = [
        np.stack([-1.5 + radius * np.sin(angle), radius * (1 - np.cos(angle))], axis=-1)
        for radius in np.linspace(0.6, 3.2, 20)
    ]
    points = np.concatenate(circles)
    found = NAMED_OBSTACLES[name]
    assert found
    for time in np.linspace(0.0, 12.0, 60):
        places = [(np.array([p.x, p.y]), p.radius) for p in found.posts]
        places += [(w.place(np.array(time)), w.radius) for w in found.walkers]
        for place, radius in places:
            assert np.hypot(*(points - place).T).min() > radius + 0.32
    for wall in found.walls:
        ends = np.array([[wall.x0, wall.y0], [wall.x1, wall.y1]])
        along = np.diff(ends, axis=0)[0]
        share = np.clip((points - ends[0]) @ along / (along @ along), 0, 1)
        assert np.hypot(*(points - ends[0] - share[:, None] * along).T).min() > 0.32
