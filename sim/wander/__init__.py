"""Simulated teleoperated drives: sprocket commands, the motion that follows, and poses of any sensor."""
