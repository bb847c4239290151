import pytest

from experiments.speed.memory import peak_memory
from experiments.speed.pipeline import scale
from experiments.speed.scale_case import ScaleCase

CASES = scale.cases_of((1, 16))
LINEAR = {(robots, duration): duration * (1e-3 + 2e-3 * robots) for robots, duration, _ in CASES}


def cases(times, memory=lambda robots, duration: 150.0 + 0.01 * robots):
    return [ScaleCase(*key, seconds, memory(*key), memory(key[0], key[1] / 2), 1.0) for key, seconds in times.items()]


def failing(found):
    return [f"{one.case}: {one.what}" for one in found if not one.holds]


def test_what_is_linear_holds():
    found = scale.checks_of(cases(LINEAR))
    assert failing(found) == []
    assert found[-1].value == pytest.approx(0.0, abs=1e-9)


def test_time_that_grows_faster_than_the_duration_does_not_hold():
    slow = LINEAR | {(16, 1800.0): 1.2 * LINEAR[16, 1800.0]}
    found = scale.checks_of(cases(slow))
    assert failing(found)[0] == "16 robots: time per second, 1800 s over 30 s"
    assert next(one for one in found if one.case == "16 robots").value == pytest.approx(20.0)


def test_time_that_grows_faster_than_the_number_of_robots_does_not_hold():
    slow = LINEAR | {(4096, 30.0): 1.2 * LINEAR[4096, 30.0]}
    assert "256 robots and more: spread of the time per robot" in failing(scale.checks_of(cases(slow)))


def test_memory_that_grows_with_the_duration_does_not_hold():
    found = scale.checks_of(cases(LINEAR, lambda robots, duration: 150.0 + 0.05 * duration))
    assert failing(found) == [f"{name}: memory, 1800 s over 30 s" for name in ("1 robot", "16 robots")]
    found = scale.checks_of(cases(LINEAR, lambda robots, duration: 150.0 + 0.001 * robots * duration))
    assert failing(found)[-1] == "4096 robots: memory, whole run over half"


def test_long_runs_of_any_number_of_robots_can_be_driven():
    chosen = [(robots, duration) for robots, duration, _ in scale.cases_of((1, 16, 256, 4096))]
    assert chosen == [(robots, duration) for robots in (1, 16, 256, 4096) for duration in (30.0, 1800.0)]
    assert (256, 1800.0) not in [case[:2] for case in CASES]


def test_bench_prints_the_cases_and_the_checks(trackslip, monkeypatch):
    monkeypatch.setattr(scale, "measure_cases", lambda chosen, seed, step: cases(LINEAR))
    result = trackslip("bench", "--scale", "--repeats", "1")
    assert "4096" in result.printed
    assert "deviation from a + b N" in result.printed
    assert len(result.summary["rows"]) == len(CASES)
    assert all(one["holds"] for one in result.summary["checks"])


@pytest.mark.slow
def test_memory_does_not_grow_with_the_duration():
    labels = []
    taken = [(8, 30.0, 2), (8, 240.0, 1), (256, 8.0, 1), (256, 24.0, 1)]
    few, few_for_long, many, many_for_long = scale.measure_cases(taken, 0, lambda label, share: labels.append(label))
    assert peak_memory() is None or few_for_long.memory - few.memory < 10.0
    assert peak_memory() is None or many_for_long.memory - many.memory < 20.0
    assert 4 < few_for_long.file_size / few.file_size < 16
    assert labels[0] == "8 robots, 30 s"
    assert len(labels) > 2 * len(taken)
