"""Courses by name and from TOML files: what they are, and what is said of those that are wrong."""

import dataclasses

import numpy as np
import pytest
from rays import compiled

from sim.terrain import Course, Flat, Mesh, Ramp, Rough, Stairs, course_names, load_course
from trackslip.errors import InvalidValueError, SettingsFileError

RAMP = '[[pieces]]\nkind = "ramp"\n'


@pytest.mark.parametrize("name", course_names())
def test_every_named_course_compiles_and_has_a_level_start_and_goal(name):
    course = load_course(name)
    model, _ = compiled(course)
    assert model.ngeom >= 2
    around = np.linspace(-0.5, 0.5, 11)
    assert (course.height(course.start[0] + around, 0.0) == 0.0).all()
    assert np.ptp(course.height(course.goal + around, 0.0)) == 0.0


def test_names():
    assert {
        "flat",
        "ramp20",
        "step10",
        "stairs",
        "cross_beams",
        "pallets",
        "rough",
        "gap",
        "side_slope",
        "arena",
    } <= set(course_names())


def test_a_file_is_the_course_that_it_describes(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        "width = 2\nfriction = 0.5\nseed = 7\nstart_length = 3.0\n"
        '[[pieces]]\nkind = "stairs"\nrise = -0.1\nnumber = 3\nwidth = inf\n'
        '[[pieces]]\nkind = "rough"\namplitude = 0.05\n'
    )
    course = load_course(str(path))
    assert course == Course((Stairs(-0.1, number=3), Rough(amplitude=0.05)), 2.0, 0.5, 7, 3.0)
    assert load_course(str(path), seed=8) == dataclasses.replace(course, seed=8)


def test_files_of_a_piece_are_beside_the_course(tmp_path):
    (tmp_path / "roof.obj").write_text("v 0 0 0\nv 2 0 0\nv 2 1 1\nv 0 1 1\nf 1 2 3\nf 1 3 4\n")
    (tmp_path / "mine.toml").write_text('[[pieces]]\nkind = "mesh"\nfile = "roof.obj"\n')
    assert load_course(str(tmp_path / "mine.toml")).pieces == (Mesh(str(tmp_path / "roof.obj")),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "pieces = (): must be at least one piece"),
        ("pieces = 3", "pieces = 3: must be a list of tables"),
        ("pieces = [3]", "pieces[0]: 3 is not a table"),
        ("[[pieces]]\nangle = 1", "pieces[0]: kind = None: must be one of flat, ramp, step, stairs"),
        ('[[pieces]]\nkind = "stair"', "pieces[0]: kind = 'stair': must be one of flat, ramp"),
        ("[[pieces]]\nkind = [1]", "pieces[0]: kind = [1]: must be one of flat, ramp"),
        (RAMP + "slope = 1", "pieces[0]: slope is unknown; known are angle, length"),
        (RAMP + "angle = nan", "pieces[0]: angle = nan: must be from -1.2 to 1.2 rad"),
        (RAMP + 'angle = "20"', "pieces[0]: angle = '20': must be a number"),
        ('[[pieces]]\nkind = "stairs"\nnumber = 3.0', "pieces[0]: number = 3.0: must be a whole number"),
        ('[[pieces]]\nkind = "stairs"\nnumber = true', "pieces[0]: number = True: must be a whole number"),
        (
            '[[pieces]]\nkind = "stairs"\nnumber = 9999',
            "pieces[0]: number = 9999: must be a whole number from 1 to 500",
        ),
        ('[[pieces]]\nkind = "picture"', "pieces[0]: file is missing"),
        ('[[pieces]]\nkind = "picture"\nfile = 3', "pieces[0]: file = 3: must be a text"),
        ('[[pieces]]\nkind = "picture"\nfile = "none.png"', "none.png: "),
        ("frictoin = 1\n" + RAMP, "frictoin is unknown; known are pieces, width, friction, seed"),
        ("friction = -1\n" + RAMP, "friction = -1.0: must be a finite number > 0"),
        ("seed = -1\n" + RAMP, "seed = -1: must be a whole number >= 0"),
        ("seed = 1.5\n" + RAMP, "seed = 1.5: must be a whole number"),
        ("width = 0\n" + RAMP, "width = 0.0: must be from 0.001 to 200 m"),
        (
            'width = 200\n[[pieces]]\nkind = "rough"\ncell = 0.005',
            "cells along a side of rough ground = 40001: must",
        ),
        ("[[pieces]\n", "not TOML"),
    ],
)
def test_a_wrong_file_is_one_line_with_file_and_field(tmp_path, text, message):
    path = tmp_path / "course.toml"
    path.write_text(text)
    with pytest.raises(SettingsFileError) as error:
        load_course(str(path))
    line = str(error.value)
    assert line.startswith(str(tmp_path))
    assert message in line
    assert "\n" not in line


def test_other_names_are_refused_with_those_that_are_known():
    for name in ("", "stair", "../courses/stairs", "x" * 5000):
        with pytest.raises(InvalidValueError, match=r"must be one of arena, cross_beams, .*, or a .toml file"):
            load_course(name)
    with pytest.raises(SettingsFileError, match="No such file"):
        load_course("none.toml")
    with pytest.raises(InvalidValueError, match="seed = -3"):
        load_course("flat", seed=-3)


def test_pieces_in_a_file_have_the_defaults_of_the_classes():
    assert load_course("side_slope").pieces[0].blend == 1.0
    assert isinstance(load_course("ramp20").pieces[1], Flat)
    assert load_course("ramp20").pieces[0] == Ramp(0.3491, 3.0)
