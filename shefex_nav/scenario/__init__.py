"""Scenario files in human units -> checked models -> parameters in SI."""
