"""`trackslip identify`: slip laws from a stored grid or from a real robot's log."""
