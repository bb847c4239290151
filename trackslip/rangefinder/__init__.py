"""A stationary laser range finder: from whole scans of any place to poses of the plate on the robot."""
