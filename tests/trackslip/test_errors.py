"""Numbers out of range, and what isn't a number, are named in one line."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from trackslip.errors import InvalidValueError, require_at_most, require_finite, require_non_negative, require_positive

CHECKS = (require_positive, require_non_negative, require_finite, partial(require_at_most, limit=2.0))


@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize("value", [1, 1.0, np.float32(1), np.int64(1), np.array(1.0)])
def test_numbers_of_any_kind_are_taken(check: Callable[[str, object], None], value: object) -> None:
    check("mass", value)


@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize("value", ["1", None, [1.0, 2.0], np.array([1.0, 2.0]), float("nan"), 1j])
def test_what_is_no_number_is_refused_by_name(check: Callable[[str, object], None], value: object) -> None:
    with pytest.raises(InvalidValueError, match=r"^mass = .*: must be "):
        check("mass", value)


@pytest.mark.parametrize(("check", "value"), list(zip(CHECKS, (0.0, -1e-9, float("inf"), 2.1), strict=True)))
def test_numbers_out_of_range_are_refused(check: Callable[[str, object], None], value: float) -> None:
    with pytest.raises(InvalidValueError, match="mass"):
        check("mass", value)
