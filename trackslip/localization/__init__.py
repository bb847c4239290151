"""From one scan to the pose of the plate, with covariance (paper, Sec. III-B)."""
