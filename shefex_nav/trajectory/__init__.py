"""Trajectories of others, along which a scenario flies in place of a vehicle of its own.

rows           what every reader gives: rows in inertial axes, and how they are rounded
placing        frames of files -> inertial axes
csv_file       a CSV whose columns the scenario names
exports        RocketPy, OpenRocket, RASAero II
ccsds          OEM and AEM
log_file       a log of this program
along          an attitude along the velocity
reading        from the section of a scenario to its rows
plausible      what rows get wrong: units, frames, steps, too few of them
flight         a scenario with a trajectory to its Flight
"""
