"""References: pose and twist over time for a controller to follow."""
