"""A laser range finder beside the field: from whole scans of any place to poses of the plate on the robot."""
