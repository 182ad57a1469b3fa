"""Software of your own on board: what it is told, what it gives, and how it is reached.

    from shefex_nav.software import Estimate

    class MyFilter:
        def start(self, alignment, mission): ...
        def step(self, imu, arrived): return Estimate(r_i, v_i, q_ib, P)

`navigation.software: my_navigation.py:MyFilter` in a scenario flies it; docs/how-to/software.md explains.

mission     what software is told before the flight
flown       from a scenario to the software that flies
built_in    the filter of the program as such software
messages    what goes to a program of its own and comes back, as protobuf messages
codec       one record to bytes and back
channels    standard input and output, TCP, UDP
remote      a program of its own, as the simulator sees it
server      the other end, in Python
"""

from shefex_nav.onboard.own_computer import Computer as Computer
from shefex_nav.onboard.own_navigation import Estimate as Estimate
from shefex_nav.onboard.own_navigation import Navigation as Navigation
from shefex_nav.onboard.own_tracker import Solved as Solved
from shefex_nav.onboard.own_tracker import StarTracker as StarTracker
from shefex_nav.records import CameraCommand as CameraCommand
from shefex_nav.software.mission import MissionData as MissionData


def serve(software, address=None):
    """Be the program that flies: answer a simulator until it has no more ticks.

    software : Navigation, Computer or StarTracker
    address : 'tcp://127.0.0.1:5005', 'udp://127.0.0.1:5005' to listen at; None: the simulator has started
        this program and talks by standard input and output
    """
    from shefex_nav.software.server import serve

    serve(software, address)
