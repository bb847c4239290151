"""The laser range finder: its beams and errors, obstacles in its field, and scans of a fleet."""
