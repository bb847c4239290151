"""Odometry by a slip law: poses with covariance from encoders, and the errors of these poses."""
