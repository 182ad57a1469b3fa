"""Fly a scenario from Python and look at what came out; a log read back gives the same object.

    scenario = Scenario.load("shefex2_andoya")
    run = fly(scenario, seed=1)
    run.solution.q_ib            # (N, 4), 100 times a second
    run.errors().attitude_b      # (N, 3) rad, truth minus estimate
    run.frames[300.0].image_dn   # the picture of the star camera at T+300 s
    run.frames[300.0].plot()     # ... with what was found in it: a matplotlib Figure, as all pictures
    run.plot.attitude()
    run.errors().at(run.event("entry").t_s).position_i

Arrays are in SI units and radians; the frames of their components are the last letter of their names.

flying    a scenario is flown, logged and kept
room      where the truth of a long flight lies
run       what came out: Run, and its Errors
frames    the pictures of a run
"""

from shefex_nav.runs.flying import fly as fly
from shefex_nav.runs.flying import get_ready as get_ready
from shefex_nav.runs.frames import Frames as Frames
from shefex_nav.runs.frames import SeenFrame as SeenFrame
from shefex_nav.runs.run import Errors as Errors
from shefex_nav.runs.run import Run as Run
from shefex_nav.runs.run import open_run as open_run
