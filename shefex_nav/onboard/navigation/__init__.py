"""Delayed error-state Kalman filter over a 400 Hz strapdown."""
