"""Six degrees of freedom from the pad to the ground.

params              what is flown: vehicle, start, air
settings, tasks     masses, start and devices; the attitude programme
timeline            its moments, in order
start               on the rail, in orbit, on the ground
fly                 flies section after section
integrate           one section: `runge_kutta` with the equations of `dynamics`
vehicle, aerodynamics, devices   mass and inertia; forces; spin motors, yo-yo, cold gas, parachute
surroundings        Earth, air, wind
control             cold gas along the path of `attitude_program`
events, record      what happened; the record of the flight
scene               values of the flight for the kernels
track, given        a flight along a trajectory of others: curves through its rows, and the truth along them
"""
