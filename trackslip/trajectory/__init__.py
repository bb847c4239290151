"""References: what a controller is asked to follow, as pose and twist over time."""
