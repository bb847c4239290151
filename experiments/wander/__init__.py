"""`trackslip wander`: drive as a person with a joystick does, and log as a real robot does."""
