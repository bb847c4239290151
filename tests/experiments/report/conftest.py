import pytest
from wandered import identified_from, wandered


@pytest.fixture(scope="session")
def two_drives():
    """Laws identified from two drives, one of them with outlying poses."""
    return identified_from(wandered(outliers=4), wandered(name="again", duration=20.0, seed=1))


@pytest.fixture(scope="session")
def without_headings():
    """Laws identified from a drive without headings."""
    return identified_from(wandered(headings=False, duration=40.0))
