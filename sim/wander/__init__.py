"""Drives as people make them: sprocket commands of teleoperation, the motion that follows, poses of any sensor."""
