import numpy as np
import pytest

from sim.path_tracking.episode import ReferenceTable
from trackslip.errors import InvalidValueError
from trackslip.trajectory.named import named_reference

NAMES = ("circle", "paper", "stop_and_go")


def test_rows_are_the_references_at_the_instants_of_control():
    steps = np.array([0, 4, 20])
    table = ReferenceTable(NAMES, steps)
    index, k = np.array([1, 0, 2]), np.array([[0, 0, 0], [37, 400, 900], [120, 838, 1]]).T
    for row, name in enumerate(np.array(NAMES)[index]):
        reference = named_reference(name)
        np.testing.assert_array_equal(table.pose(index[row], k[row]), reference.pose(k[row] * 0.05))
        later = (k[row][:, None] + steps) * 0.05
        np.testing.assert_array_equal(table.twists(index[row], k[row]), reference.twist(later))
        assert (table.last[index[row]] - 1) * 0.05 < reference.duration <= table.last[index[row]] * 0.05 + 1e-9
    np.testing.assert_array_equal(table.pose(index, k[:, 1])[2], table.pose(2, np.array([k[2, 1]]))[0])


def test_beyond_the_end_it_stands():
    table = ReferenceTable(NAMES, np.array([0, 4]))
    for index, name in enumerate(NAMES):
        far = np.array([table.last[index] + 4, 10_000])
        np.testing.assert_array_equal(table.twists(index, far), 0)
        end = named_reference(name).pose(named_reference(name).duration)
        np.testing.assert_allclose(table.pose(index, far), [end, end])


def test_a_reference_is_added_once():
    table = ReferenceTable(NAMES, np.zeros(1, int))
    assert table.index("slalom") == 3
    assert table.index("slalom") == 3
    assert table.names == [*NAMES, "slalom"]
    assert len(table.path(3)) == table.last[3] + 1
    with pytest.raises(InvalidValueError, match="moon"):
        table.index("moon")
