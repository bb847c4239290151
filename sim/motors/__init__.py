"""The motors of tracks and wheels: one torque-speed law, one servo, one balance with the ground."""
