"""Poses of the plate from single scans, with covariances (paper, Sec. III-B)."""
