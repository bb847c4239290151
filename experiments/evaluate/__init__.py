"""`trackslip evaluate`: how far odometry by slip laws is off on a log."""
