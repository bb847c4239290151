from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from figures import assert_readable

from experiments.train.config import Config
from experiments.train.page import learning_chart, page, smoke_test, success_figure

pytestmark = pytest.mark.usefixtures("with_figures")
CURVE = [{"steps": 1024.0 * k, "reward": 0.1 * k} for k in range(1, 11)]


def rate(course, controller, crossed):
    return {
        "course": course,
        "controller": controller,
        "difficulty": 0.85,
        "courses": 10,
        "crossed": crossed,
        "tipped": 0,
        "stuck": 10 - crossed,
        "rate": crossed / 10,
        "low": max(0.0, crossed / 10 - 0.3),
        "high": min(1.0, crossed / 10 + 0.3),
        "time": None,
    }


RATES = [
    rate(course, controller, crossed)
    for course, both in (("steps_up", (8, 9)), ("a_course_with_a_long_name", (0, 10)))
    for controller, crossed in zip(("scripted", "policy"), both, strict=True)
]


def test_few_steps_are_a_smoke_test_and_an_alarm():
    answer = page(Config(steps=4096), 4096, CURVE, [], [], {}).answer
    assert answer.alarms == [smoke_test(4096)]
    assert answer.alarms[0].startswith("4,096 steps are a smoke test")
    assert answer.facts[0] == ("reward per step", "0.100 → 1.000")
    enough = page(Config(), 2_000_000, CURVE, [], [], {}).answer
    assert enough.alarms == []
    assert enough.heading == "Reward per step 0.100 → 1.000 in 2,000,000 steps"


def test_the_learning_curve_has_its_running_mean_from_seven_updates_on():
    updates, mean = learning_chart(CURVE).curves
    np.testing.assert_allclose(updates.x, np.arange(1, 11) * 1.024)
    np.testing.assert_allclose(mean.y, [0.4, 0.5, 0.6, 0.7])
    assert len(learning_chart(CURVE[:6]).curves) == 1


def test_success_is_shown_per_course():
    config = replace(Config(env="traverse", courses=("steps_up", "rails")), out=Path("out/mine"))
    found = page(config, 4096, CURVE, RATES, [], {})
    facts = dict(found.answer.facts)
    assert facts["courses crossed, scripted"] == "8 of 20"
    assert facts["courses crossed, policy"] == "19 of 20"
    assert found.answer.next == ["trackslip drive --policy out/mine"]
    (axes,) = assert_readable(success_figure(RATES)).axes
    names = [text.get_text() for text in axes.get_yticklabels()]
    assert names[1] == "a_course_with_a_long_name, difficulty 0.85"
