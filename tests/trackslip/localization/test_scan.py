import numpy as np

from trackslip.localization.scan import Cluster, Plate, extract_plate


def test_clusters_in_parts_are_the_whole(scan_rectangle):
    poses = np.column_stack([np.linspace(1.0, 6.0, 12), np.zeros(12), np.linspace(0.3, 2.8, 12)])
    scan = scan_rectangle(poses, np.random.default_rng(0))
    scan.ranges[4] = np.nan
    whole = extract_plate(scan, Plate())
    assert whole.count[4] == 0
    joined = Cluster.joined([whole.take(np.arange(5)), whole.take(np.arange(5, 12))])
    some = whole.take(np.array([2, 7])).among(np.isin(np.arange(12), [2, 7])).take(np.array([2, 7]))
    for part, rows in ((joined, np.arange(12)), (some, np.array([2, 7]))):
        for name, values in vars(whole.take(rows)).items():
            np.testing.assert_array_equal(getattr(part, name), values)
    low, high = whole.extremes(whole.range)
    assert low[4] == high[4] == 0
    assert low[3] == whole.range[whole.row == 3].min()
    np.testing.assert_allclose(whole.sums(whole.range)[5], whole.range[whole.row == 5].sum())
