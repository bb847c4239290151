"""The laser range finder: beams, errors, obstacles, scans of a fleet."""
