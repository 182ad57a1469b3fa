"""What a calibration of the lens does to attitudes: rendered pictures of drawn attitudes, lost in space.

Each attitude, away from the Sun, is exposed by the star camera of a scenario at rest above the Earth and
answered by its star tracker: behind a pinhole; behind a lens with a barrel of 1 % in the corner, told
rightly; told as a pinhole; told with a residual of 0.2 px rms, and the same with its size in
`star_tracker.centroid_floor`. Printed are mean and scatter of the error about x, y, z; NEES over its mean,
3; the attitude error that the residual is predicted to make with stars all over the field
(`scenario.lens.left`); stars found and residual of a frame.

    uv run python benchmarks/lens_distortion.py [--seed 1] [--each 400] [--scenario night_sky] [--of NAME]
"""

import argparse
from collections import Counter

import numpy as np
from scipy.stats import chi2

from shefex_nav import prepare
from shefex_nav.environment.ephemeris import julian_year
from shefex_nav.geometry.rotation import dcm_from_quat, quat_conjugate, quat_multiply, rotvec_between
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.papers.stills import random_attitude
from shefex_nav.records import CameraCommand, Reason, Trajectory
from shefex_nav.scenario import lens, load
from shefex_nav.scenario.told import as_told
from shefex_nav.world.camera import expose

ARCSEC = np.degrees(1.0) * 3600.0
BARREL = "star_camera.optics.distortion=[-0.376, 0, 0, 0, 0]"  # 1 % at the corner of the SHEFEX-2 camera
TOLD = "navigation.told.star_camera.optics.distortion"
LEFT = f"{TOLD}=[-0.326, 0, 0.002, 0, 0]"
VARIANTS = {
    "pinhole": (),
    "right": (BARREL,),
    "not told": (BARREL, f"{TOLD}=[0, 0, 0, 0, 0]"),
    "0.2 px": (BARREL, LEFT),
    "0.2 px, floor": (BARREL, LEFT, "star_tracker.centroid_floor=0.2 pix"),
}
EXACT = ("star_camera.optics.focal_length_error=0 %", "star_camera.optics.principal_point_error=0 pix")
T_S, HEIGHT = 100.0, 7000e3  # s; m from the centre of the Earth, above which the camera looks up


def at_rest(camera, q_ic):
    """Trajectory of a vehicle that stands still while its camera (Camera) looks so."""
    q_ib = quat_multiply(q_ic, quat_conjugate(camera.q_bc))
    t_s = T_S + np.arange(401) / 400.0
    n, zero = len(t_s), np.zeros((len(t_s), 3))
    r_i = np.tile(HEIGHT * dcm_from_quat(q_ic)[:, 2], (n, 1))
    others = dict.fromkeys(Trajectory._fields)  # the camera does not ask
    moves = {"t_s": t_s, "r_i": r_i, "v_i": zero, "q_ib": np.tile(q_ib, (n, 1)), "omega_ib_b": zero}
    return Trajectory(**others | moves)


def dark_attitude(seed, k, sun_u_i):
    """q_ic of a camera that looks away from the Sun, anywhere else."""
    rng = np.random.default_rng([seed, k])
    while True:
        q_ic = random_attitude(rng)
        if dcm_from_quat(q_ic)[:, 2] @ sun_u_i < 0.0:
            return q_ic


def answers(scenario, seed, each):
    """Errors (n, 3) rad, sigmas (n, 3), NEES, residuals [px], stars of what is solved; reasons of all."""
    world = prepare.build_world(scenario, seed, brief=True)
    tracker = star_tracker.init(world.computer.tracker, world.catalogue, julian_year(scenario.mission.epoch))
    velocity_i = world.camera.bodies.earth_v_i
    context = star_tracker.NO_CONTEXT._replace(velocity_i=velocity_i, rate=0.0)
    exposure = scenario.star_tracker.exposure
    command = CameraCommand(T_S, exposure.longest, exposure.gain)
    rows, reasons = [], Counter()
    for k in range(each):
        q_ic = dark_attitude(seed, k, world.camera.bodies.sun_u_i)
        rng = np.random.default_rng([seed, k, 1])
        frame, truth = expose(world.camera, command, at_rest(world.camera, q_ic), k, T_S, rng)
        state, _ = star_tracker.start(tracker, T_S)
        _, fix, _ = star_tracker.step(tracker, state, frame, context)
        reasons[Reason(fix.reason).name] += 1
        if fix.reason == Reason.NONE:
            d = rotvec_between(fix.q_ic, truth.q_ic)
            nees = d @ np.linalg.solve(fix.P_c, d) / 3.0
            rows.append((*d, *np.sqrt(np.diag(fix.P_c)), nees, fix.residual_px, (fix.hip > 0).sum()))
    return np.array(rows).reshape(-1, 9), reasons


def main():
    """Print a line of each variant."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--each", type=int, default=400)
    parser.add_argument("--scenario", default="night_sky")
    parser.add_argument("--of", choices=VARIANTS)
    parser.add_argument("--set", action="append", default=[])
    args = parser.parse_args()
    for name in [args.of] if args.of else VARIANTS:
        scenario = load.load(args.scenario, [*EXACT, *args.set, *VARIANTS[name]])
        rows, reasons = answers(scenario, args.seed, args.each)
        left = lens.left(scenario.star_camera, as_told(scenario).star_camera)
        turn = np.zeros(3) if left is None else np.array(left.turn)
        print(f"{name}: {reasons['NONE']} of {args.each} solved; {dict(reasons)}")
        if not len(rows):
            continue
        n, e = len(rows), rows[:, :3] * ARCSEC
        low, high = chi2.ppf([0.0005, 0.9995], 3 * n) / (3 * n)
        if left is not None:
            print(f"  left {left.rest_px:.3f} px rms, predicted error {np.round(turn * ARCSEC, 2)} arcsec")
        print(
            f"  error: mean {np.round(e.mean(axis=0), 2)}, rms {np.round(np.sqrt((e**2).mean(axis=0)), 2)}, "
            f"largest {np.round(np.abs(e).max(axis=0), 1)} arcsec; sigma "
            f"{np.round(np.sqrt((rows[:, 3:6] ** 2).mean(axis=0)) * ARCSEC, 2)}\n"
            f"  NEES {rows[:, 6].mean():.2f} ({low:.2f} to {high:.2f}); residual {rows[:, 7].mean():.3f} px, "
            f"stars {rows[:, 8].mean():.1f}"
        )


if __name__ == "__main__":
    main()
