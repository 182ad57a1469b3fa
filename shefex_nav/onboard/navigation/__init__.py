"""Delayed error-state Kalman filter over a 400 Hz strapdown.

state, blocks                    which errors are estimated, in which order
calibration, strapdown           IMU increments without the estimated errors; their integration
error_model, prediction, ticks   how errors grow; one tick; many ticks in which nothing arrives
measurements, measure_*          linearised measurements
sensors, aid, aiding             the table of GPS and stars; an instrument as such a sensor
gate, eskf                       acceptance and reset; update, and a covariance that was too small
history, fusion                  the last seconds; every measurement at its instant
hypotheses, unknown_attitude     several filters where an angle of the attitude is not known
adaptation, noise_evidence       noise that was told too small
integrity*, protected            monitors of the sensors; protection levels
solution, covariance             what the filter reports of a tick
"""
