"""The filter of the program in the place of software of one's own: to compare ways, and to start from.

navigation: {software: shefex_nav.software.built_in:BuiltIn}
navigation: {software: {command: python -m shefex_nav.software.built_in}}
"""

import numpy as np

from shefex_nav.onboard import navigator
from shefex_nav.records import ImuBlock
from shefex_nav.scenario import load, params_onboard


class BuiltIn:
    """The built-in filter, a `Navigation`."""

    def start(self, alignment, mission):
        """Begin at the alignment, with what the scenario says of the filter."""
        scenario = load.load_text(mission.scenario, "the scenario")
        params = params_onboard.nav_params(scenario)
        self._navigator = navigator.start(params, alignment, mission.earth)

    def step(self, imu, arrived):
        """A tick."""
        self._navigator.advance(ImuBlock(*(np.array([field]) for field in imu)), 0, 1)
        return self._navigator.update(arrived)

    def context(self, frame, sky, predicts):
        """What the filter knows about a frame."""
        return self._navigator.context(frame, sky, predicts)


if __name__ == "__main__":
    from shefex_nav.software import serve

    serve(BuiltIn())
