"""What the navigation filter assumes, as far as a mission and a replay of data say it in the same sections.

Missions (`params_onboard`) and replays (`replay.params`) have sections `imu` and `navigation` alike; what
they have besides, star camera and GPS receiver, goes on top. Vibration is acceleration of flat density S
between f_low and f_high, as section `imu.vibration` has it: noise of samples, swings of the sensors.
"""

import numpy as np

from shefex_nav.onboard.navigation.blocks import left_as_noise
from shefex_nav.records import QUANTITIES
from shefex_nav.scenario import aboard
from shefex_nav.scenario.of_settings import settings
from shefex_nav.world import vibration as spectrum


def common(scenario, integrity):
    """Fields of NavParams that follow from section `navigation` alone. Scenario, IntegrityParams -> dict"""
    navigation = settings(scenario.navigation)
    keys = ("gate_probability", "star_fix_floor", "release", "gps_agreement", "gps", "stars")
    return {name: getattr(navigation, name) for name in keys} | {
        "states": aboard.estimated(scenario),
        "own_blocks": aboard.own_blocks(scenario),
        "integrity": integrity,
    }


def memory_s(history_s, latency_s, period_s):
    """How far back the filter remembers: what the scenario says, and the motion before a fix that is late.

    period_s : the longest of the vibration, `integrity_constants`
    """
    from shefex_nav.onboard.navigation.integrity_constants import LONGEST_S, SPAN_S

    return max(history_s, latency_s + min(period_s, LONGEST_S) + SPAN_S)


def integrity_params(scenario, dt_s, coarse_if_silent, shaken=(0.0, 0.0)):
    """IntegrityParams.

    Parameters
    ----------
    scenario : with sections `imu` and `navigation`
    dt_s : duration of one IMU sample
    coarse_if_silent : readings of which the scenario does not say how coarse they are may be of any
        coarseness, as those of files that others have rounded: an axis may repeat itself then, and each
        sample is rounded by itself, where a unit carries what is left over on to the next
    shaken : rad, m/s rms, what vibration without a motor does to a sample
    """
    from shefex_nav.onboard.navigation import integrity_imu, integrity_readings, integrity_watch

    navigation = settings(scenario.navigation)
    integrity = navigation.integrity
    triads = (scenario.imu.gyro, scenario.imu.accelerometer)
    repeats = [
        np.inf
        if coarse_if_silent and not triad.quantum
        else integrity_readings.repeats(
            triad.random_walk * np.sqrt(dt_s), triad.quantum, not coarse_if_silent
        )
        for triad in triads
    ]
    again = [
        integrity_readings.evidence(np.hypot(triad.random_walk * np.sqrt(dt_s), swing), triad.quantum)
        for triad, swing in zip(triads, shaken, strict=True)
    ]
    return integrity_watch.IntegrityParams(
        imu=integrity_imu.ImuRules(
            again=np.array([first for first, _ in again]),
            further=np.array([further for _, further in again]),
            repeats=np.array(repeats),
            range=np.array([triad.range for triad in triads]),
            wrong=np.array([navigation.saturated_rate, navigation.saturated_acceleration]),
            change=np.array([integrity.angular_acceleration, integrity.thrust_change]),
            missed=_missed(scenario),
        ),
        wanted=required(scenario.requirements),
        wrong_star_fix=integrity.wrong_star_fix,
        gps_jump=integrity.gps_jump,
    )


def required(stated):
    """What the protection levels are held against, of section `requirements`."""
    from shefex_nav.onboard.navigation import integrity_protection

    limits = (getattr(stated, quantity).limit for quantity in QUANTITIES)
    return integrity_protection.requirement(*limits, stated.integrity_risk)


def _missed(scenario):
    """Sigma of what a reading at the end of its range leaves out: (2,) rad/s, m/s^2.

    A vehicle that turns faster than its gyros can show may turn twice as fast.
    """
    rate, limit = scenario.navigation.saturated_rate, scenario.imu.gyro.range
    most = max(rate, limit) if np.isfinite(limit) else rate
    return np.array([most, scenario.navigation.saturated_acceleration])


def imu_model(scenario, told, **others):
    """ImuModel: errors that are no states of the filter, from the data sheet of the IMU.

    A bias that wanders with sigma and correlation time tau (Gauss-Markov) starts out as a random walk of
    density sigma sqrt(2/tau). Slews turn the vehicle about any axis: scale factor on one axis and
    misalignment on two count by their rms. If the vehicle spins meanwhile, the axes across take turns: what
    is left of them is the mean of two scale factors along the turn and half the difference of two
    misalignments athwart it; that of the roll axis is left only if its rate across stays in one body axis.
    Errors whose block is estimated are left out.

    told : blocks.Beforehand
    others : fields that follow from something else, or are given otherwise
    """
    from shefex_nav.onboard.navigation.state import ImuModel

    navigation, gyro, accelerometer = scenario.navigation, scenario.imu.gyro, scenario.imu.accelerometer
    left = left_as_noise(navigation.states, told)
    scale_factor, misalignment = left["gyro_scale"], left["gyro_misalignment"]
    cross2 = (scale_factor**2 + 2.0 * misalignment**2) / 3.0
    fields = {
        "gyro_random_walk": gyro.random_walk,
        "gyro_bias_walk": float(gyro.in_run_bias * np.sqrt(2.0 / gyro.in_run_bias_time)),
        "gyro_cross": float(np.sqrt(cross2)),
        "spun_along": misalignment**2 / cross2 if cross2 else 0.0,
        "spun_across": 0.25 * (scale_factor**2 + misalignment**2) / cross2 if cross2 else 0.0,
        "manoeuvre_angle": navigation.manoeuvre_angle,
        "gyro_g_sensitivity": left["gyro_g_sensitivity"],
        "gyro_rectification": 0.0,
        "gyro_vibration": 0.0,
        "gyro_quantum": gyro.quantum,
        "accel_random_walk": accelerometer.random_walk,
        "accel_bias_walk": float(accelerometer.in_run_bias * np.sqrt(2.0 / accelerometer.in_run_bias_time)),
        "accel_scale": left["accel_scale"],
        "accel_misalignment": left["accel_misalignment"],
        "accel_rectification": left["accel_rectification"],
        "accel_vibration": 0.0,
        "thrust_threshold": navigation.thrust_threshold,
        "shake_threshold": np.inf,
        "thrust_time_s": navigation.thrust_memory,
        "gravity": left["gravity"],
        "gravity_time_s": navigation.gravity_memory,
        "saturated_rate": navigation.saturated_rate,
        "accel_quantum": accelerometer.quantum,
    }
    return ImuModel(**fields | others)


def strongest(vibration):
    """Vibration while the strongest motor burns, m/s^2 rms."""
    return max(vibration.boost, default=0.0)


def imu_fields(imu, dt_s):
    """Fields of ImuModel that follow from the vibration by the strongest motor. Section imu, s of a sample"""
    vibration = imu.vibration
    gyro_swing, accel_swing = swings(vibration, strongest(vibration)).tolist()
    return {
        "gyro_rectification": imu.gyro.vibration_rectification * strongest(vibration) ** 2,
        "gyro_vibration": gyro_swing,
        "accel_vibration": accel_swing,
        "shake_threshold": _shake_threshold(vibration, dt_s),
    }


def at_rest(vibration, dt_s):
    """What vibration without a motor does to a sample of gyros and accelerometers: rad, m/s rms."""
    velocity = float(np.sqrt(_in_increments(vibration, vibration.coast**2, dt_s)))
    return vibration.angular * velocity, velocity


def swings(vibration, level):
    """Angle and velocity of a vibration of some level [m/s^2 rms], (2,) rad, m/s rms.

    S integrated: sigma^2 = S/(2 pi)^2 (1/f_low - 1/f_high).
    """
    low, high = vibration.lowest_frequency, vibration.highest_frequency
    density = level**2 / (high - low)
    velocity = float(np.sqrt(density * (1.0 / low - 1.0 / high)) / (2.0 * np.pi))
    return np.array([vibration.angular * velocity, velocity])


def _shake_threshold(vibration, dt_s):
    """Noise of velocity increments that tells a burning motor from coasting, m/s rms.

    Half way, as levels go, between the weakest motor and coasting, of which at least a hundredth of the motor
    is assumed.
    """
    weakest = min((level for level in vibration.boost if level > 0.0), default=np.inf)
    level2 = weakest * max(vibration.coast, 0.01 * weakest)
    return float(np.sqrt(_in_increments(vibration, level2, dt_s)))


def _in_increments(vibration, level2, dt_s):
    """Variance of velocity increments over dt_s by a vibration of some mean square, m^2/s^4: m^2/s^2.

    S has the variance S dt/2 in the increment of dt, and the share of its band.
    """
    return 0.5 * level2 / spectrum.bandwidth(vibration) * dt_s * spectrum.share(vibration, dt_s)
