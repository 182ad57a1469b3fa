"""Magnetometer: the Earth's magnetic field at the vehicle in body axes, as its sensor reports it.

The field is that of the World Magnetic Model at the true place and the date of the mission, and what no such
model has, of crust and outer currents: a field of its own in level axes, first-order Gauss-Markov along the
path, with the scatter that the model states of itself. Of B in body axes the sensor reports

    B_m = (I + S) B + h + noise,

h the hard iron of vehicle and sensor, S the soft iron, scale factors and misalignments together, each element
drawn by itself; then limited and counted in whole quanta (Groves, 2nd ed., section 6.1.1).
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import IMU_HZ
from shefex_nav.environment import magnetic_field
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import MagnetometerReading

ANOMALY_LENGTH = 50e3  # m [E], along the path, over which the field of the crust goes with itself


class MagnetometerParams(NamedTuple):
    """Sensor and vehicle; sigmas are one standard deviation of what is drawn per run and axis."""

    rate: float  # Hz, a divisor of 100
    latency_s: float  # from the instant measured to the reading on board
    hard_iron: float  # T
    soft_iron: float  # of the field
    noise: float  # T, of one reading, white
    quantum: float  # T; 0: none
    range: float  # T, largest field on an axis
    year: float  # decimal, of the mission


class Errors(NamedTuple):
    """What was drawn for one run."""

    hard_iron: np.ndarray  # (3,) T
    soft_iron: np.ndarray  # (3, 3)


class MagnetometerData(NamedTuple):
    """Readings of a flight, and what is wrong with them."""

    readings: list  # of MagnetometerReading
    errors: Errors


def measure(params, trajectory, earth, rng):
    """Readings along a trajectory.

    Parameters
    ----------
    params : MagnetometerParams
    trajectory : Trajectory
    earth : EarthRotation
    rng : Generator; as many numbers are drawn whatever `params` says but for its rate

    Returns
    -------
    MagnetometerData
    """
    errors = Errors(params.hard_iron * rng.standard_normal(3), params.soft_iron * rng.standard_normal((3, 3)))
    every = round(IMU_HZ / params.rate)
    k = np.arange(every, len(trajectory.t_s), every)
    white, drive = rng.standard_normal((2, len(k), 3))
    true_b = _true(params.year, trajectory, earth, k, drive)
    read = true_b @ (np.eye(3) + errors.soft_iron).T + errors.hard_iron + params.noise * white
    counted = np.round(read / params.quantum) * params.quantum if params.quantum else read
    at_limit = (np.abs(counted) >= params.range).any(axis=1)
    field_b = np.clip(counted, -params.range, params.range)
    readings = [
        MagnetometerReading(t_s, t_s + params.latency_s, field, limit)
        for t_s, field, limit in zip(trajectory.t_s[k].tolist(), field_b, at_limit.tolist(), strict=True)
    ]
    return MagnetometerData(readings, errors)


def _true(year, trajectory, earth, k, drive):
    """Field in body axes at samples k: (n, 3) T. drive : (n, 3) white, of what the model has not."""
    harmonics, sigma_n = magnetic_field.load(year), magnetic_field.sigma_n(year)
    out, more, before = np.empty((len(k), 3)), drive[0], None
    for j, sample in enumerate(k.tolist()):
        C_ei = frames.dcm_ie(earth, trajectory.t_s[sample]).T
        r_e = C_ei @ trajectory.r_i[sample]
        if before is not None:
            keeps = np.exp(-np.linalg.norm(r_e - before) / ANOMALY_LENGTH)
            more = keeps * more + np.sqrt(1.0 - keeps**2) * drive[j]
        latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
        b_e = magnetic_field.field_e(harmonics, r_e) + wgs84.dcm_en(latitude, longitude) @ (sigma_n * more)
        out[j], before = rotation.dcm_from_quat(trajectory.q_ib[sample]).T @ C_ei.T @ b_e, r_e
    return out
