"""`trackslip train`: a policy trained in the learning environments."""
