"""The laser range finder: its beams and errors, the obstacles around it, and scans of a fleet."""
