"""What the instruments of a flight measured, as a folder of CSVs with a replay file that reads them.

One row an IMU sample, a fix, a reading, as loggers of others write them: for software of others, and as an
example of what `replay` takes. Star fixes are left out, since replays have none.

The assumptions of the replay file are those of the mission: data sheets of the instruments, lever arm,
latency, states. It starts from the truth, as well as the mission knew it; in orbit to ALIGNED.
"""

from datetime import UTC, datetime, timedelta

import numpy as np
import yaml

from shefex_nav.errors import UserError
from shefex_nav.files import put, whole
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.instruments import BUILT_IN
from shefex_nav.replay import load, schema
from shefex_nav.report import configured, local_level
from shefex_nav.report.track import earth_fixed
from shefex_nav.scenario import layers, params_onboard

REPLAY = "replay.yaml"
ALIGNED = {"level": "0.05 deg", "azimuth": "0.5 deg", "position": "5 m", "velocity": "0.1 m/s"}  # [E]
BRIDGED_S, MOST_BRIDGED_S = 0.1, 0.99  # without IMU samples: unless a replay is told of more, and at most
TIME_AND_PLACE = "t_s", "latitude_deg", "longitude_deg", "height_m"
VELOCITY = "vn_m_s", "ve_m_s", "vd_m_s"
ATTITUDE = "roll_deg", "pitch_deg", "heading_deg"
SIGMAS = *(f"sigma_{axis}_m" for axis in "ned"), *(f"sigma_v{axis}_m_s" for axis in "ned")
TRUE = "t_s", "r_i", "v_i", "q_ib"
LEFT_OUT = "told", "software", "stars", "gps"  # of `navigation`: what a replay decides by itself


class NoDataError(UserError):
    """A log whose measurements cannot be written as a replay reads them."""


def write(data, folder):
    """Write the CSVs and the replay file of a RunData into a folder. -> names of the files"""
    if not len(data.truth.t_s) or local_level.is_replay(data):
        with_truth = "" if len(data.truth.t_s) else " without truth"
        raise NoDataError(f"is of a replay{with_truth}, whose data are in files already")
    if not any(fix.valid for fix in data.gps):
        raise NoDataError("has no GPS fix")
    imu, gap_s = _imu(data.imu)
    truth = _truth(data, imu["t_s"][0])
    files = {"imu.csv": imu, "gnss.csv": _gnss(data.gps), "truth.csv": truth}
    read = [one for one in BUILT_IN.values() if one.data and len(data.readings[one.name].t_valid_s)]
    files |= {f"{one.name}.csv": _readings(one, data.readings[one.name]) for one in read}
    folder.mkdir(exist_ok=True)
    for name, columns in files.items():
        _put_csv(folder / name, columns)
    described = _described(data, read, imu["t_s"], truth["t_s"][0], gap_s)
    text = yaml.safe_dump(described, sort_keys=False, allow_unicode=True, default_flow_style=None, width=100)
    head = [f"shefex-nav replay {REPLAY}", *remarks(data)]
    put(folder / REPLAY, "".join(f"# {words}\n" for words in head) + f"\n{text}")
    load.load(str(folder / REPLAY))
    return [*files, REPLAY]


def remarks(data):
    """What the mission knew of the fixes of a RunData and a replay cannot be told: list of str."""
    said, found = layers.parsed(data.mission.scenario_text, data.mission.scenario).tree, []
    if (said.get("navigation", {}).get("told") or {}).get("gps"):
        words = "navigation.told.gps: the noise of the fixes is that of the receiver, not what the filter was"
        found.append(f"{words} told of it")
    return found


def _put_csv(path, columns):
    import pyarrow as pa
    from pyarrow import csv

    with whole(path) as part:
        csv.write_csv(pa.table(columns), part)


def _axes(name, values):
    return {f"{name}_{axis}": column for axis, column in zip("xyz", values.T, strict=True)}


def _imu(blocks):
    """Columns of the samples that there are, and the longest time between two of them, s."""
    samples = blocks.dtheta_b.shape[1]
    step_s = np.diff(blocks.t_valid_s)
    if len(step_s) and np.median(step_s) > 1.5 * samples * np.median(blocks.dt_s):
        raise NoDataError("does not hold every sample of the IMU; fly it with log.rate: 100 Hz")
    ends_s = blocks.t_valid_s[:, None] - np.arange(samples - 1, -1, -1) * np.reshape(blocks.dt_s, (-1, 1))
    kept = np.repeat(np.asarray(blocks.valid, dtype=bool), samples)
    t_s = ends_s.ravel()[kept]
    if len(t_s) < 2:
        raise NoDataError("has no samples of the IMU")
    at = int(np.argmax(np.diff(t_s)))
    if (gap_s := float(t_s[at + 1] - t_s[at])) > MOST_BRIDGED_S:
        raise NoDataError(
            f"has no sample of the IMU for {gap_s:.3g} s after T{t_s[at]:+.2f} s, too long to bridge"
        )
    turn, gain = blocks.dtheta_b.reshape(-1, 3)[kept], blocks.dv_b.reshape(-1, 3)[kept]
    return {"t_s": t_s} | _axes("dtheta_rad", turn) | _axes("dv_m_s", gain), gap_s


def _gnss(fixes):
    """Columns of place, velocity and sigmas in level axes; 0 where there is no fix."""
    rows = np.zeros((len(fixes), 14))
    for row, fix in zip(rows, fixes, strict=True):
        row[0], row[13] = fix.t_valid_s, fix.valid
        if fix.valid:
            latitude, longitude, height = wgs84.geodetic_from_ecef(fix.r_ea_e)
            C_ne = wgs84.dcm_en(latitude, longitude).T
            row[1:4] = np.degrees(latitude), np.degrees(longitude), height
            row[4:7] = C_ne @ fix.v_ea_e
            variances = [np.diag(C_ne @ R @ C_ne.T) for R in (fix.R_r_e, fix.R_v_e)]
            row[7:13] = np.sqrt(np.maximum(np.ravel(variances), 0.0))
    return dict(zip((*TIME_AND_PLACE, *VELOCITY, *SIGMAS, "valid"), rows.T, strict=True))


def _of_fixes(data):
    """What the replay file says of the fixes: without height, and without velocity, where they have none."""
    fixes = [fix for fix in data.gps if fix.valid]
    said = {"file": "gnss.csv", "time": "t_s", "position": list(TIME_AND_PLACE[1:]), "valid": "valid"}
    said["position_sigma"] = list(SIGMAS[:3])
    if fixes[0].horizontal:
        said |= {"position": said["position"][:2], "position_sigma": said["position_sigma"][:2]}
        said["height"] = f"{data.mission.launch_height:.6g} m"
    if np.isfinite(fixes[0].v_ea_e).all():
        said |= {"velocity": [*VELOCITY], "velocity_sigma": list(SIGMAS[3:])}
    return said


def _truth(data, from_s):
    """Columns of place, velocity and attitude in level axes, from a mission time on."""
    earth, since = data.mission.earth, np.searchsorted(data.truth.t_s, from_s)
    truth = data.truth._replace(**{name: getattr(data.truth, name)[since:] for name in TRUE})
    track = earth_fixed(earth, truth)
    rows = np.empty((len(truth.t_s), 10))
    rows[:, 0], rows[:, 3] = truth.t_s, track.height
    rows[:, 1], rows[:, 2] = np.degrees(track.latitude), np.degrees(track.longitude)
    for k, (row, C_ie) in enumerate(zip(rows, frames.dcms_ie(earth, truth.t_s), strict=True)):
        C_ne = wgs84.dcm_en(track.latitude[k], track.longitude[k]).T
        row[4:7] = C_ne @ track.v_e[k]
        row[7:] = np.degrees(euler.euler_from_dcm(C_ne @ C_ie.T @ rotation.dcm_from_quat(truth.q_ib[k])))
    return dict(zip((*TIME_AND_PLACE, *VELOCITY, *ATTITUDE), rows.T, strict=True))


def _column(instrument):
    """The first DataColumn of an instrument, in which readings are given as they are."""
    return next(one for one in instrument.data if one.convert is None)


def _readings(instrument, records):
    """Columns of the readings of an instrument, in SI."""
    column = _column(instrument)
    values = getattr(records, column.field)
    return {"t_s": records.t_valid_s} | (_axes(column.key, values) if column.vector else {column.key: values})


def _of_readings(instrument):
    """What the replay file says of them."""
    column = _column(instrument)
    names = list(_axes(column.key, np.eye(3))) if column.vector else column.key
    unit = {f"{column.key}_unit": column.si}
    return {"file": f"{instrument.name}.csv", "time": "t_s", column.key: names, **unit}


def _of_mission(said, read, lasting):
    """Sections of a replay file that a scenario has as well, of what the computer on board is told of it.

    said : a scenario as YAML has it;  read : instruments of which there are readings;  lasting: of `_lasting`
    """
    told = said.get("navigation", {}).get("told") or {}
    imu = {
        name: _over(said["imu"][name], told.get("imu", {}).get(name))
        for name in ("gyro", "accelerometer", "vibration")
    }
    gps = _over(said["gps"], told.get("gps"))
    filtered = {
        key: value
        for key, value in said.get("navigation", {}).items()
        if key in schema.ReplayNavigation.keys() and key not in LEFT_OUT
    }
    known = {*schema.OF_DATA, *(block.name for one in read for block in one.states)}
    filtered["states"] = [name for name in filtered.get("states", ()) if name in known]
    return {
        "earth": _only(said.get("earth", {}), schema.ReplayEarth),
        "gnss": {"lever_arm": gps["antenna"]["lever_arm"], "latency": gps["latency"]} | lasting,
        "alignment": {"method": "reference", **said.get("pad_alignment", ALIGNED)},
        "imu": {
            name: _only(one, schema.ReplayImu.model_fields[name].annotation) for name, one in imu.items()
        },
        **{one.name: _over(said[one.name], told.get(one.name)) for one in read},
        "navigation": filtered,
        "requirements": {
            key: {"limit": one["limit"]} if isinstance(one, dict) else one
            for key, one in _only(said.get("requirements", {}), schema.ReplayRequirements).items()
        },
    }


def _over(section, told):
    """A section with the values that are told in their place."""
    if not isinstance(told, dict):
        return section if told is None else told
    return section | {key: _over(section.get(key), value) for key, value in told.items()}


def _only(section, model):
    """What of a section a replay file has too."""
    return {key: value for key, value in section.items() if key in model.keys()}


def _described(data, read, t_s, true_from_s, gap_s):
    """The replay file, as YAML has it.

    read : instruments of which there are readings;  t_s : (N,) of the IMU samples;  gap_s : the longest time
    without one
    """
    said, gnss = layers.parsed(data.mission.scenario_text, data.mission.scenario).tree, _of_fixes(data)
    imu = {"file": "imu.csv", "rate": f"{1.0 / np.median(np.diff(t_s)):.6g} Hz", "time": "t_s"}
    imu |= {"gyro": list(_axes("dtheta_rad", np.eye(3))), "gyro_unit": "rad"}
    imu |= {"accelerometer": list(_axes("dv_m_s", np.eye(3))), "accelerometer_unit": "m/s"}
    truth = {"file": "truth.csv", "time": "t_s", "position": list(TIME_AND_PLACE[1:])}
    truth |= {"velocity": [*VELOCITY], "attitude": [*ATTITUDE]}
    others = {one.name: _of_readings(one) for one in read}
    bridged = {"longest_gap": f"{1.01 * gap_s:.3g} s"} if gap_s > BRIDGED_S else {}
    begins = datetime.fromisoformat(data.mission.epoch_utc).replace(tzinfo=UTC) + timedelta(
        seconds=float(t_s[0])
    )
    return {
        "mission": {
            "name": data.mission.scenario.partition(" ")[0],  # "(replayed)" may follow
            "description": f"Measurements of seed {data.mission.seed}, without star fixes",
            "epoch": begins.isoformat().replace("+00:00", "Z"),
            "start": f"{true_from_s - t_s[0]:.6g} s",
        },
        "data": {"format": "csv", **bridged, "imu": imu, "gnss": gnss, "truth": truth, **others},
        **_of_mission(said, read, _lasting(data)),
    }


def _lasting(data):
    """What section `gnss` of a replay file says of errors that last: those of the receiver of a RunData."""
    scenario = configured.configured(data).scenario
    share = 0.0 if scenario is None else params_onboard.lasting_share(scenario)
    if not share:
        return {}
    time_s = scenario.navigation.sensors.range_bias_time
    return {"lasting_share": f"{100.0 * share:.3g} %", "lasting_time": f"{time_s:g} s"}
