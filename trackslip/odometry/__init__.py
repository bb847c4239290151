"""Odometry by a slip law: poses with covariance from encoders, and how far they are off."""
