"""`trackslip train`: train a policy in the learning environments."""
