"""One scan -> pose of the plate, with covariance (paper, Sec. III-B)."""
