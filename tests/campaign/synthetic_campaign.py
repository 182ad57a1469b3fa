"""Folder of a campaign whose answers are known because they were made, in the form that a campaign leaves.

Attitude error x at entry: 0.05 deg times (0.6 u + 0.8 w), u the standardised draw of the payload's mass and w
noise: correlation 0.6, R^2 0.36. Attitude y and z are noise of 0.05 deg. The position error grows with the
distance of the launch elevation from its nominal value, to both sides. Errors over time are stationary
Gauss-Markov processes of the sigma that the covariance says, times `truth_over_sigma`.
"""

import io
import json
from functools import cache
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from shefex_nav.campaign.flight import Flown
from shefex_nav.campaign.plan import FORMAT
from shefex_nav.campaign.store import Store
from shefex_nav.records import Phase

SCENARIO = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"
MASS, MASS_SIGMA, ELEVATION, ELEVATION_SIGMA = 487.5, 5.0, 86.43, 0.2
ATTITUDE_SIGMA_DEG, CORRELATION = 0.05, 0.6
POSITION_M, POSITION_PER_SIGMA_M = 10.0, 20.0
MEAN_PLACE = (71.0, 15.0)  # deg
NORTH_KM, EAST_KM, TURN_DEG = 8.0, 2.0, 30.0  # sigmas of the dispersion along axes turned from north to east
T, STEP_S = 40, 1.0
SIGMAS = {"position": 3.0, "velocity": 0.05, "attitude": 1e-3, "gyro_bias": 1e-6, "accel_bias": 1e-4}
FRAMES, AVAILABILITY = 1000, 0.97
OUTSIDE = 100  # fixes before and after the window, of a run
USABLE_H = 0.1  # of a run
BROKEN_MASS = 495.0  # kg, from here on a run with `breaks` fails


@cache
def source():
    from shefex_nav.scenario import load

    return load.load(SCENARIO).source


def write(folder, n, *, seed=1, truth_over_sigma=1.0, breaks=False, with_series=True, **head):
    """Write the folder of a campaign of n runs. -> folder"""
    folder.mkdir(parents=True)
    kept = {
        "format": FORMAT, "scenario": "synthetic", "source": source(), "digest": "", "seed": seed, "runs": n,
        "sampling": "random", "flight": "dispersed", "rate": 1.0 / STEP_S, "dispersions": {},
        "versions": {}, "wall_s": 123.0, "timed": {"runs": n, "wall_s": 120.0},
    }  # fmt: skip
    (folder / "campaign.json").write_text(json.dumps(kept | head))
    with Store(folder) as store:
        store.runs.keep((one, None) for one in flown(n, seed, truth_over_sigma, breaks, with_series))
    return folder


def flown(n, seed, truth_over_sigma, breaks, with_series):
    """Flown of each run."""
    for run in range(n):
        rng = np.random.default_rng([seed, run])
        record = one_record(run, rng, breaks=breaks)
        has_series = with_series and record["status"] == "succeeded"
        yield Flown(record, series(rng, truth_over_sigma) if has_series else None)


def one_record(run, rng, *, breaks=False):
    """Record of a run."""
    u, v, w = rng.standard_normal(3)
    draws = {
        "vehicle.payload.mass": MASS + MASS_SIGMA * u,
        "launch.elevation": ELEVATION + ELEVATION_SIGMA * v,
        "imu.gyro.bias": float(rng.uniform(0.2, 1.0)),
        "star_tracker.detection.centroid": str(rng.choice(["fit", "weighted"], p=[0.8, 0.2])),
    }
    record = {
        "run": run, "status": "succeeded", "reason": "", "traceback": "", "seed": 1000 + run, "draws": draws,
        "summary": {}, "series_sha256": "", "timing": {"wall_s": float(rng.uniform(1.0, 2.0))},
    }  # fmt: skip
    if breaks and draws["vehicle.payload.mass"] > BROKEN_MASS:
        mass = draws["vehicle.payload.mass"]
        return record | {
            "status": "failed",
            "reason": f"FlightError: T{0.01 * run:+.2f} s: {mass:.1f} kg is more than the thrust can lift",
            "traceback": "Traceback (most recent call last):\n  ...",
        }
    return record | {"summary": summary(rng, u, v, w)}


def summary(rng, u, v, w):
    """What `metrics.summarise` would return, with the errors above."""
    rho = CORRELATION
    attitude = ATTITUDE_SIGMA_DEG * np.array([rho * u + np.sqrt(1.0 - rho**2) * w, *rng.standard_normal(2)])
    position = POSITION_M + POSITION_PER_SIGMA_M * abs(v) + abs(rng.standard_normal())
    north, east = NORTH_KM * rng.standard_normal(), EAST_KM * rng.standard_normal()
    turn = np.radians(TURN_DEG)
    dn, de = north * np.cos(turn) - east * np.sin(turn), north * np.sin(turn) + east * np.cos(turn)
    # radii of curvature of WGS 84 at 71 deg, plus 177 km, to 1e-4: 6393.1 and 6397.3 km
    latitude = MEAN_PLACE[0] + np.degrees(dn / (6392.7 + 177.0))
    longitude = MEAN_PLACE[1] + np.degrees(de / ((6397.3 + 177.0) * np.cos(np.radians(MEAN_PLACE[0]))))
    place = {"t_s": 250.0, "latitude_deg": latitude, "longitude_deg": longitude, "altitude_km": 177.0}
    return {
        "scenario": "synthetic", "seed": 1, "version": "0", "log": None, "ended_early": False,
        "simulated_s": 500.0, "wall_s": float(rng.uniform(1.0, 2.0)), "setup_s": 0.5,
        "real_time_factor": 250.0,
        "flight": {"apogee_km": 177.0 + 0.1 * u, "at_apogee": place, "at_entry": None, "events": [
            {"name": "impact", "t_s": 495.0, "altitude_km": 0.0}]},
        "attitude_control": None,
        "star_tracker": {
            "frames": 1200, "in_window": FRAMES, "wrong": 0, "no_fix": {"too_few_stars": 3},
            "solved": (solved := int(rng.binomial(FRAMES, AVAILABILITY))), "fixes": solved + OUTSIDE,
            "error_arcsec": {"cross_axis_rms": 12.0, "mean": [1.0, 2.0, 3.0]},
            "by_rate": [{"from_deg_s": 0.0}],
            "chain_ms": {"median": float(rng.uniform(3.0, 4.0)), "p99": 9.0},
        },
        "navigation": {
            "position_error_m": {"rms": float(position), "max": 2.0 * float(position)},
            "velocity_error_m_s": {"rms": 0.05, "max": 0.2},
            "attitude_error_deg": {"rms": 0.05, "max": 0.2},
            "at_entry": {
                "t_s": 430.0, "altitude_km": 100.0, "attitude_error_deg": attitude.tolist(),
                "position_error_m": float(position), "velocity_error_m_s": float(abs(rng.normal(0.0, 0.1))),
            },
            "integrity": {"misleading_share": 0.0, "at_entry": {"usable": True}} | {
                quantity: {"usable_h": USABLE_H, "misleading_share": 0.0, "misleading_events": 0,
                           "over_level": float(rng.uniform(0.3, 0.6)), "at_entry": {"usable": True}}
                for quantity in ("position", "velocity", "attitude")
            },
        },
    }  # fmt: skip


def series(rng, truth_over_sigma):
    """Bytes of the series of a run."""
    arrays = {"t_s": -3.0 + STEP_S * np.arange(T), "phase": np.full(T, Phase.COAST, np.int8)}
    arrays["phase"][T // 2 :] = Phase.DESCENT
    z = {name: gauss_markov(rng) * truth_over_sigma for name in SIGMAS}
    for name, sigma in SIGMAS.items():
        frame = {"attitude": "_b", "velocity": "_i", "position": "_i"}.get(name, "")
        arrays[f"{name}_error{frame}"] = sigma * z[name]
        arrays[f"{name}_sigma{frame}"] = np.full((T, 3), sigma)
    order = ("attitude", "velocity", "position", "gyro_bias", "accel_bias")
    arrays["nees"] = np.column_stack([(z[name] ** 2).sum(axis=1) for name in order])
    arrays["nis_sum.gps"], arrays["nis_dof.gps"] = rng.chisquare(6, T) * truth_over_sigma**2, np.full(T, 6.0)
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()


def gauss_markov(rng, keeps=0.9):
    """(T, 3) of unit variance at every epoch."""
    drive = rng.standard_normal((T, 3)) * np.sqrt(1.0 - keeps**2)
    drive[0] /= np.sqrt(1.0 - keeps**2)
    return lfilter([1.0], [1.0, -keeps], drive, axis=0)
