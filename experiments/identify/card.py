"""The answer from an identification, for the terminal and the top of its page."""

import math
import shlex
from collections.abc import Sequence
from typing import Final

from experiments.common.page import Answer
from trackslip.identification.answer import TOO_LITTLE
from trackslip.identification.comparison import REFERENCE
from trackslip.identification.drive_comparison import TODAY
from trackslip.identification.prediction import FAR_AHEAD, PredictionErrors
from trackslip.identification.result import Identification
from trackslip.intervals import Gain
from trackslip.laws.families import FAMILIES
from trackslip.logs.runlog import in_few_lines
from trackslip.views.numbers import with_interval
from trackslip.views.values import multiplier_values, parameter_values

LINES: Final = 25  # largest number of lines on the terminal, including the report's path
_AHEAD: Final = 5.0  # horizon of the errors that are printed [s]
_MOST_ALARMS: Final = 4
_MOST_NOTES: Final = 2


def card(result: Identification, out: str | None = None, taken: Sequence[str] = ()) -> Answer:
    """The answer, with notes on data `taken` from bags, and with the next commands if `out`
    contains the results.
    """
    fits = result.main.laws
    name = result.expressible
    facts = multiplier_values(result)
    shown = dict.fromkeys(law for law in (name, result.best) if law is not None)
    for law in shown:
        prefix = "" if law == name or name is None else f"{law}: "
        facts += [(f"{prefix}{letter}", value) for letter, value in parameter_values(fits[law])]
    reason = result.main.reason
    sentence = reason[:1].upper() + reason[1:]
    facts.append(("best law", f"{result.best} ({FAMILIES[result.best].title}). {sentence}"))
    if name is not None and name != result.best:
        facts.append(("deployed", f"{name}, whose parameters the multipliers are"))
    if error := error_today_and_now(result):
        facts.append(("error today → now", error))
    if error := far_error_today_and_now(result):
        facts.append((f"after {FAR_AHEAD:g} m", error))
    warnings = _few(in_few_lines(result.warnings), _MOST_NOTES)
    notes = [f"note: {line}" for line in warnings]
    lines = [*_look(result), *_other_method(result), *_few(taken, _MOST_NOTES), *notes]
    alarms = [alarm.line for alarm in result.alarms]
    commands = _commands(result, out)
    return Answer(f"Best law: {result.best}", facts, lines, alarms=alarms, next=commands)


def _with_interval(gain: Gain) -> str:
    """A gain with its interval, or why it has none."""
    return with_interval(gain.value, gain[1:], why_none=TOO_LITTLE)


def print_card(answer: Answer, report: str) -> None:
    """Print an answer in at most LINES lines: alarms, values, sentences, and the next commands."""
    alarms = [f"ALARM: {line}" for line in _few(answer.alarms, _MOST_ALARMS)]
    width = max(len(name) for name, _ in answer.facts)
    values = [f"{name:<{width}}  {value}" for name, value in answer.facts]
    commands = [f"next: {line}" for line in answer.next]
    tail = [*commands, f"report: {report}"]
    room = max(0, LINES - len(alarms) - len(values) - len(tail))
    for line in [*alarms, *values, *answer.lines[:room], *tail]:
        print(line)


def error_today_and_now(result: Identification) -> str:
    """Prediction errors without identification and with the best law; empty if they aren't
    known.
    """
    if result.method == "steady" or result.drive is None:
        validation = result.comparison.validation
        before = validation.get("none")
        after = validation.get(result.best)
        if before is None or after is None:
            return ""
        return (
            f"yaw rate at left-out radii: {1e3 * before.yaw_rate:.3g} → "
            f"{1e3 * after.yaw_rate:.3g} mrad/s (rms)"
        )
    today = result.drive.errors.get(TODAY, {})
    now = result.drive.errors.get(result.best, {})
    if not now:
        return ""
    ahead = min(now, key=lambda horizon: abs(horizon - _AHEAD))
    return f"{ahead:g} s ahead, {_before_and_after(today[ahead], now[ahead])} (median)"


def far_error_today_and_now(result: Identification) -> str:
    """Prediction errors after FAR_AHEAD metres, without identification and with the best law; empty
    if they aren't known.
    """
    if result.method == "steady" or result.drive is None:
        return ""
    today = result.drive.far_errors.get(TODAY)
    now = result.drive.far_errors.get(result.best)
    if today is None or now is None:
        return ""
    return f"{_before_and_after(today, now, per_metre=False)} (median)"


def _two_digits(value: float) -> str:
    """A number rounded to two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def _before_and_after(old: PredictionErrors, new: PredictionErrors, per_metre: bool = True) -> str:
    """Median errors of two predictions of the same motions, in position and heading."""
    parts: list[str] = []
    if old.position is not None and new.position is not None:
        part = f"position {old.position.median:.3f} → {new.position.median:.3f} m"
        if per_metre:
            cm = 1e2 / new.way
            before = _two_digits(cm * old.position.median)
            after = _two_digits(cm * new.position.median)
            part += f" ({before} → {after} cm per metre)"
        parts.append(part)
    if old.heading is not None and new.heading is not None:
        before = f"{math.degrees(old.heading.median):.1f}"
        after = f"{math.degrees(new.heading.median):.1f}"
        parts.append(f"heading {before} → {after}°")
    return " and ".join(parts)


def _look(result: Identification) -> list[str]:
    """A line on the gains from the first look, if there are any."""
    if result.drive is None or result.method == "steady":
        return []
    look = result.drive.look
    parts = []
    if look.gains.speed is not None:
        parts.append(f"speed gain {_with_interval(look.gains.speed)}")
    if look.gains.turn is not None:
        parts.append(f"turn gain {_with_interval(look.gains.turn)}")
    if look.clock:
        ahead = "encoders" if look.clock > 0 else "poses"
        parts.append(f"clocks {abs(look.clock):.2g} s apart (that of the {ahead} is ahead)")
    return [f"first look: {', '.join(parts)}"] if parts else []


def _other_method(result: Identification) -> list[str]:
    """A line on the estimate of D from the method that isn't used, if there is one."""
    other = result.drive if result.method == "steady" else result.steady
    if other is None or REFERENCE not in other.laws:
        return []
    parameters = parameter_values(other.laws[REFERENCE])
    values = ", ".join(f"{letter} = {value}" for letter, value in parameters)
    driving = "whole drives" if result.method == "steady" else "steady stretches"
    return [f"cross-check on {driving} ({REFERENCE}): {values}"]


def _few(lines: Sequence[str], most: int) -> list[str]:
    """At most `most` lines, followed by a line with the number of lines left out, if any."""
    more = len(lines) - most
    if more <= 0:
        return [*lines]
    return [*lines[:most], f"{more:,} more in the report"]


def _commands(result: Identification, out: str | None) -> list[str]:
    """Command lines to run next; laws with an alarm are not offered for deployment."""
    if not out:
        return []
    folder = shlex.quote(out)
    evaluate = f"trackslip evaluate ANOTHER_LOG --law {folder}"
    deploy = f"trackslip deploy {folder}"
    return [evaluate] if result.alarms else [evaluate, deploy]
