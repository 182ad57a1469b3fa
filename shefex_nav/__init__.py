"""Hybrid INS/GPS/star-tracker navigation simulator for sounding rockets and small satellites.

The route of the data, which the folder listing repeats::

    scenarios/*.yaml -> scenario -> world (flight, IMU, GPS, star camera frames)
                     -> onboard (star tracker, navigation) -> log (MCAP) -> report, view

``world`` is what happens, ``onboard`` is what flies; neither imports the other. They meet in
``records`` (what is measured) and in ``simulate`` (the wiring).

Conventions
-----------
Frames, one letter each, right-handed:

- ``i`` inertial, axes of the GCRS, origin at the centre of the Earth
- ``e`` Earth-centred Earth-fixed, WGS 84 (ITRS)
- ``n`` north, east, down at the vehicle
- ``l`` launch site: east, north, up
- ``b`` body = IMU: x along the roll axis towards the nose, y and z across it
- ``c`` camera: x right along the rows, y down along the columns, z along the boresight

Rotations: ``C_ab`` and ``q_ab`` take components in b to components in a, ``v_a = C_ab @ v_b``; the
letters must meet, ``C_ec = C_eb @ C_bc``. Quaternions are Hamilton's, scalar first, unit norm.

Vectors end in the frame of their components: ``v_e``, ``g_i``, ``f_b``. Relative quantities are written
in full: ``omega_ib_b`` is the rate of b with respect to i in components of b, ``r_ea_e`` the position of
point a (GPS antenna) from the centre of e in components of e.

Units: SI and radians inside; a scalar that is not obviously SI says so (``t_s``, ``sigma_px``). Human
units appear in scenario files and in reports only. Time ``t_s`` counts from lift-off.

Error states: truth = estimate (+) error; the attitude error is a rotation vector in body axes,
``q_ib(true) = q_ib(estimate) * exp(dtheta_b)``.

Pixels: (0, 0) is the centre of the top-left pixel, x to the right, y down.
"""

import os as _os
import sys as _sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # what `__getattr__` imports, for editors and type checkers
    from shefex_nav.campaign.from_python import fly_campaign as fly_campaign
    from shefex_nav.campaign.results import open_campaign as open_campaign
    from shefex_nav.errors import UserError as UserError
    from shefex_nav.runs import fly as fly
    from shefex_nav.runs import open_run as open_run
    from shefex_nav.scenario.load import Scenario as Scenario
    from shefex_nav.solve.camera import Camera as Camera
    from shefex_nav.solve.centroids import solve_centroids as solve_centroids
    from shefex_nav.solve.image import solve_image as solve_image

__version__ = "0.1.0"


def _is_command():
    """Whether this process is the command line, not a worker of it or a program of somebody's own."""
    name, given = (getattr(_sys, "argv", None) or [""])[0], _sys.orig_argv
    script = _os.path.basename(name) == "shefex-nav" and "--multiprocessing-fork" not in given
    return script or (name == "-m" and "shefex_nav" in given)


if _is_command():  # what Ctrl-C does is told first of all
    from shefex_nav import stopping as _stopping

    _stopping.of_process()

from shefex_nav.compiled import target as _target  # noqa: E402

_target.choose(_os.environ)


_PUBLIC = {
    "Scenario": "scenario.load",
    "fly": "runs",
    "open_run": "runs",
    "fly_campaign": "campaign.from_python",
    "open_campaign": "campaign.results",
    "Camera": "solve.camera",
    "solve_centroids": "solve.centroids",
    "solve_image": "solve.image",
    "UserError": "errors",
}


def __getattr__(name):
    """The public functions are imported when they are asked for: commands start without them."""
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_PUBLIC[name]}"), name)


def __dir__():
    return [*globals(), *_PUBLIC]
