from types import SimpleNamespace

import numpy as np

from experiments.common.laws import law_looks
from experiments.evaluate.page import OTHER_COLOURS, path_chart

MEASURED = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])


def prediction(name, label, shift):
    """A prediction of one drive, `shift` beside the measured path."""
    drive = SimpleNamespace(measured=MEASURED, placed=MEASURED + shift)
    model = SimpleNamespace(name=name, label=label)
    return SimpleNamespace(model=model, drive=lambda name: drive)


def test_paths_of_the_same_law_differ_in_colour():
    models = [
        ("icr_sides", "icr_sides", 0.1),
        ("icr_radius", "monday.json", 0.2),
        ("icr_radius", "tuesday.json", 0.3),
        ("icr_sides", "icr_sides with gyro", 0.4),
    ]
    measured, *curves = path_chart([prediction(*each) for each in models], "drive 0").curves
    np.testing.assert_array_equal(measured.x, MEASURED[:, 0])
    assert [curve.label for curve in curves] == [label for _, label, _ in models]
    for curve, (_, _, shift) in zip(curves, models, strict=True):
        np.testing.assert_allclose(curve.x, MEASURED[:, 0] + shift)
        np.testing.assert_allclose(curve.y, MEASURED[:, 1] + shift)
    looks = law_looks()
    colours = [curve.colour for curve in curves]
    assert colours[:2] == [looks["icr_sides"].colour, looks["icr_radius"].colour]
    assert len({measured.colour, *colours}) == 5


def test_further_colours_belong_to_no_law():
    assert not {look.colour for look in law_looks().values()} & set(OTHER_COLOURS)
