"""Independent trials that are stored as they finish."""
