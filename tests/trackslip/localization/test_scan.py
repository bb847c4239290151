import numpy as np

from trackslip.localization.scan import Cluster, Plate, extract_plate


def test_clusters_between_two_rows_are_those_rows(scan_rectangle):
    poses = np.column_stack([np.linspace(1.0, 6.0, 12), np.zeros(12), np.linspace(0.3, 2.8, 12)])
    whole = extract_plate(scan_rectangle(poses, np.random.default_rng(0)), Plate())
    first, last = whole.between(0, 5), whole.between(5, 12)
    assert last.hit.shape[1] < first.hit.shape[1]  # the plate is farther away
    for part, rows in ((first, np.arange(5)), (last, np.arange(5, 12))):
        for name, values in vars(whole.take(rows)).items():
            np.testing.assert_array_equal(getattr(part, name), values)
    joined = Cluster.joined([first, last])
    np.testing.assert_array_equal(joined.hit, whole.hit)
    np.testing.assert_array_equal(joined.range[joined.hit], whole.range[whole.hit])
