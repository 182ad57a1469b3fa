"""Sections of a scenario -> the parameters of the software that flies, in SI.

What the navigation filter assumes of the sensors is derived from their data sheets, that is, from the
sections that also drive the simulated sensors, unless `navigation.told` or `navigation.sensors` say
otherwise.
"""

import numpy as np

from shefex_nav.clock import IMU_HZ
from shefex_nav.onboard.navigation.blocks import Beforehand, known_sigmas
from shefex_nav.scenario import aboard, params_filter
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.scenario.lens import distortion_of, pinhole_of
from shefex_nav.scenario.of_settings import settings
from shefex_nav.scenario.told import as_told

SLANT_IONOSPHERE = 6.0  # m [E], at mid elevation, at least
SLANT_TROPOSPHERE = 5.0  # m
MID_ELEVATION = np.radians(30.0)
ASKED_S = 600.0  # from one look at the ionosphere of a flight to the next
UNSET_CLOCK = 300e3, 300.0  # m, m/s [E]: 1 ms, 1 ppm


def nominal_camera(scenario):
    """Pinhole of the star camera as calibrated."""
    return pinhole_of(scenario.star_camera)


def camera_model(scenario, bad_pixels):
    """CameraModel of a scenario; bad_pixels : (n, 2) row, column of the pixels found bad before flight."""
    from shefex_nav.geometry.distortion import displaced_px
    from shefex_nav.onboard.startracker.camera import CameraModel

    optics, stray_light = scenario.star_camera.optics, scenario.star_camera.stray_light
    hole, distortion = nominal_camera(scenario), distortion_of(scenario.star_camera)
    exposure, per_dn = scenario.star_tracker.exposure, electrons_per_dn(scenario)
    return CameraModel(
        pinhole=hole,
        bad_pixels=np.asarray(bad_pixels, dtype=np.int64),
        electrons_per_dn=per_dn,
        psf_sigma=optics.psf_sigma,
        zero_flux=optics.zero_magnitude_flux * exposure.longest / per_dn,
        focal_length_error=optics.focal_length_error,
        sun_exclusion=stray_light.sun_exclusion,
        earth_exclusion=stray_light.earth_exclusion,
        distortion=distortion,
        displaced_px=displaced_px(hole, distortion),
    )


def electrons_per_dn(scenario):
    """Charge for one grey value at the gain that is set."""
    gain = 10.0 ** (scenario.star_tracker.exposure.gain / 20.0)
    return scenario.star_camera.detector.conversion / gain


def computer_params(scenario, bodies, bad_pixels):
    """ComputerParams of a scenario, with the SkyBodies of the epoch; `bad_pixels` as in `camera_model`."""
    from shefex_nav.environment.ephemeris import apparent_sun
    from shefex_nav.onboard.computer import ComputerParams

    return ComputerParams(
        nav=nav_params(scenario),
        tracker=tracker_params(scenario, bodies.earth_v_i, bad_pixels),
        sun_i=apparent_sun(bodies),
    )


def tracker_params(scenario, earth_velocity_i, bad_pixels):
    """TrackerParams of a scenario.

    Parameters
    ----------
    scenario : Scenario
    earth_velocity_i : (3,) m/s, barycentric velocity of the Earth at the epoch
    bad_pixels : as in `camera_model`
    """
    from shefex_nav.onboard.startracker.tracker import TrackerParams

    return TrackerParams(
        settings=settings(scenario.star_tracker),
        camera=camera_model(as_told(scenario), bad_pixels),
        earth_velocity_i=earth_velocity_i,
        vectors=scenario.navigation.stars == "vectors",
    )


def nav_params(scenario):
    """NavParams of a scenario."""
    from shefex_nav.onboard.navigation.state import NavParams

    if scenario.navigation.states == AUTOMATIC:
        raise ValueError("navigation.states: automatic is not settled yet: prepare.settled")
    of_gps, scenario = _gps_told(scenario), as_told(scenario)
    navigation, sensors = scenario.navigation, scenario.navigation.sensors
    gyro, accelerometer = scenario.imu.gyro, scenario.imu.accelerometer
    vibration = scenario.imu.vibration
    shaken = params_filter.at_rest(vibration, 1.0 / IMU_HZ)
    integrity = params_filter.integrity_params(scenario, 1.0 / IMU_HZ, False, shaken)
    white, walk = settings(scenario.gps.clock).densities
    told, period_s = beforehand(scenario), 1.0 / vibration.lowest_frequency
    late_s = max(scenario.gps.latency, aboard.longest_latency(scenario))
    return NavParams(
        imu=_imu_model(scenario, told),
        sigma_gyro_bias=_given(sensors.gyro_bias, float(np.hypot(gyro.bias, gyro.in_run_bias))),
        sigma_accel_bias=_given(
            sensors.accelerometer_bias, float(np.hypot(accelerometer.bias, accelerometer.in_run_bias))
        ),
        sigma_blocks=known_sigmas(navigation.states, told),
        l_ba_b=np.array(_given(sensors.lever_arm, scenario.gps.antenna.lever_arm)),
        C_bc=settings(scenario.star_camera.mounting).C_bc,
        **params_filter.common(scenario, integrity),
        history_s=params_filter.memory_s(navigation.history, late_s, period_s),
        motors=_motors(scenario),
        vibration_period_s=period_s,
        swing_at_rest=params_filter.swings(vibration, vibration.coast),
        clock_white=_given(sensors.clock_white_frequency, float(np.sqrt(white))),
        clock_walk=_given(sensors.clock_random_walk, float(np.sqrt(walk))),
        range_bias_sigma=_range_bias(scenario),
        range_bias_time_s=sensors.range_bias_time,
        lasting_share=0.0 if scenario.navigation.gps == "tight" else lasting_share(scenario),
        gravity_error=navigation.gravity_error,
        aids=aboard.aids(scenario),
        gps_told=of_gps,
    )


def _gps_told(scenario):
    """GpsTold of a Scenario.

    The lasting errors of ranges are of one size for all causes, true and told; those of a fix are in its
    covariance together with its noise.
    """
    from shefex_nav.onboard.navigation.state import NOTHING_TOLD, GpsTold

    true, told = scenario.gps, scenario.navigation.told.gps
    lasting, counted = _lasting_sigma(scenario), _range_bias(as_told(scenario))
    noise = true.range_noise if told is None else _given(told.range_noise, true.range_noise)
    near = noise / true.range_noise
    known = {}
    if counted != lasting:
        known["lasting_factor"] = counted / lasting if lasting else 1.0
    if lasting or counted:
        whole = np.hypot(noise, counted) / np.hypot(true.range_noise, lasting)
        known["fix_factor"] = float(whole / near)
    if told is None:
        return GpsTold(**known) if counted != lasting else NOTHING_TOLD
    return GpsTold(
        **known,
        position_factor=near,
        velocity_factor=_given(told.range_rate_noise, true.range_rate_noise) / true.range_rate_noise,
        clock_offset_s=_given(told.clock_offset, 0.0),
        latency_s=_given(told.latency, np.nan),
    )


def beforehand(scenario):
    """Beforehand of a Scenario as the computer is told."""
    sensors, imu = scenario.navigation.sensors, scenario.imu
    return Beforehand(
        gyro=imu.gyro,
        accelerometer=imu.accelerometer,
        gyro_roll=_given(sensors.gyro_scale_factor_roll, imu.gyro.scale_factor_roll),
        gyro_misalignment=_given(sensors.gyro_misalignment, imu.gyro.misalignment),
        rectified=imu.accelerometer.vibration_rectification * params_filter.strongest(imu.vibration) ** 2,
        gravity=scenario.navigation.gravity_error,
        mounting=camera_turn(scenario),
        lever_arm=sensors.lever_arm_error,
        clock=_clock_known(scenario),
        gps_latency=sensors.gps_latency_error,
        range_bias=_range_bias(scenario),
    )


def _clock_known(scenario):
    """Sigmas of bias, m, and drift, m/s, of the receiver's clock at the start: those of a clock that nobody
    has set, or of the receiver's where that is worse."""
    sensors, (bias, drift) = scenario.navigation.sensors, settings(scenario.gps.clock).sigmas
    return (
        _given(sensors.clock_bias, max(UNSET_CLOCK[0], bias)),
        _given(sensors.clock_drift, max(UNSET_CLOCK[1], drift)),
    )


def _range_bias(scenario):
    """Sigma of range errors that last, m, as the filter is told."""
    return _given(scenario.navigation.sensors.range_bias, _lasting_sigma(scenario))


def _lasting_sigma(scenario):
    """The same of the receiver: satellites, multipath, what the models of the air leave."""
    errors = scenario.gps.errors
    sigmas = [
        errors.satellite.range if errors.satellite else 0.0,
        errors.ionosphere.residual * _slant_ionosphere(scenario) if errors.ionosphere else 0.0,
        errors.troposphere.residual * SLANT_TROPOSPHERE if errors.troposphere else 0.0,
        errors.multipath.range if errors.multipath else 0.0,
    ]
    return float(np.linalg.norm(sigmas))


def _slant_ionosphere(scenario):
    """Delay at mid elevation by the model of the receiver, the largest of the flight, m.

    Of what moves around the Earth it is not known beforehand.
    """
    site = scenario.launch or scenario.ground
    if site is None:
        return SLANT_IONOSPHERE
    from shefex_nav.environment import ionosphere, yuma

    given, mission = scenario.gps.errors.ionosphere, scenario.mission
    t_s = yuma.gps_seconds(mission.epoch) + np.arange(mission.start, mission.time_limit, ASKED_S)
    azimuth = np.radians(np.arange(0.0, 360.0, 45.0))[:, None]
    place = site.latitude, site.longitude, MID_ELEVATION, azimuth
    return max(SLANT_IONOSPHERE, float(ionosphere.klobuchar(given.alpha, given.beta, *place, t_s).max()))


def lasting_share(scenario):
    """Share of the variance of a position fix that is of errors which last; ranges have states for them."""
    lasting = _range_bias(scenario)
    return lasting**2 / (lasting**2 + scenario.gps.range_noise**2) if lasting else 0.0


def _motors(scenario):
    """From when on each motor may be the one that burns, and its vibration by the strongest's: (n, 2).

    That is known on board: a stage burns once the one below it is gone, so the instant of the ignition does
    not matter.
    """
    boost, strongest = scenario.imu.vibration.boost, params_filter.strongest(scenario.imu.vibration)
    if scenario.trajectory is not None:
        begins = [-np.inf, *scenario.trajectory.separations]
    else:
        drops = [stage.separation for stage in scenario.vehicle.stages.values()]
        begins = [-np.inf, *(np.inf if drop is None else drop.at for drop in drops)]
    rows = [(t_s, level / strongest if strongest else 0.0) for t_s, level in zip(begins, boost, strict=False)]
    return np.array(rows).reshape(-1, 2)


def camera_turn(scenario):
    """Constant attitude error of the star camera, rad, each axis, of a Scenario as the computer is told.

    That of mounting and principal point, unless `navigation.sensors` has another one.
    """
    return _given(scenario.navigation.sensors.camera_mounting, turn_of(scenario.star_camera))


def turn_of(star_camera):
    """The same of a star camera, section or settings."""
    optics = star_camera.optics
    offset = optics.principal_point_error * star_camera.detector.pixel_size / optics.focal_length
    return float(np.hypot(star_camera.mounting.error, offset))


def _given(override, value):
    """The override where there is one."""
    return value if override is None else override


def _imu_model(scenario, told):
    """ImuModel of a Scenario and its Beforehand.

    Vibration is that of the strongest motor; `NavParams.motors` has what the others do of it.
    """
    sensors, imu = scenario.navigation.sensors, scenario.imu
    others = params_filter.imu_fields(imu, 1.0 / IMU_HZ) | {
        "gyro_random_walk": _given(sensors.gyro_random_walk, imu.gyro.random_walk),
        "accel_random_walk": _given(sensors.accelerometer_random_walk, imu.accelerometer.random_walk),
    }
    return params_filter.imu_model(scenario, told, **others)
