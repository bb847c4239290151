"""Compensation of slip while driving, by a fixed law or by a law that a Kalman filter updates."""
