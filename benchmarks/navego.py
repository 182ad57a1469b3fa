"""The drive of NaveGo's MEMS IMU: accuracy and speed, here and by pyins, one after the other in one run.

uv run python benchmarks/navego.py DATA [--from 60]

Both filters have 15 states, the same samples, the same fix a second and the same assumptions, those of
scenarios/replay/navego.yaml; both begin at the reference. Seconds are of the filter alone, without reading
files and compiling: processor time on one thread, and for pyins also the wall clock as it comes, when the
threads of its matrix library get in each other's way. uv makes an environment for it.

pyins carries its covariance on every 0.2 s; here that is done at every tick, as the scenario has it every
0.02 s. The accuracy is judged with both, the speed with the step of pyins, and that of the scenario is shown.
Exit code 1 if a figure is more than 5 % above that of pyins, or the speed is below 100 times that of pyins.
"""

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from missions import SCENARIOS
from peers.run import ONE_THREAD, Peer, environment

PEER = Peer(("python-ins==1.0.1", "scipy"), "pyins_worker.py", {}, "covariance every 0.2 s")
ITS_STEP = ["navigation.samples_per_tick=40"]  # at 200 Hz
FIGURES = ("position", "velocity", "attitude")
UNITS = {"position": "m", "velocity": "m/s", "attitude": "deg"}
WITHIN, TIMES = 1.05, 100.0


def ours(scenario, files, from_s):
    """RMS errors and errors over sigma as `pyins_worker.judge`, and seconds of the filter."""
    from shefex_nav.log.run_data import RunDataBuilder
    from shefex_nav.replay import external
    from shefex_nav.report import metrics

    ready = external.prepare(scenario, files)
    external.warm_up(ready)
    clock, kept = external.Clock(), RunDataBuilder(external.mission(ready))
    for record in external.run(ready, clock):
        kept.add(record)
    found = metrics.summarise(kept.build(), from_s=from_s)["navigation"]
    names = ("position_rms_ned_m", "velocity_rms_ned_m_s", "attitude_rms_rpy_deg")
    out = {kind: found[name] for kind, name in zip(FIGURES, names, strict=True)}
    return out | {"process_s": clock.filter_s, "over_sigma": found["error_over_sigma"]}


def task(scenario, files, from_s):
    """What pyins is told, in its units: everything from the scenario and the data."""
    from shefex_nav.replay import navego

    _, gnss, _ = navego.read(scenario, files)
    start = scenario.alignment
    sensors = {"gyro": scenario.imu.gyro, "accelerometer": scenario.imu.accelerometer}
    return {name: str(path) for name, path in files.items()} | {
        "first_s": scenario.gnss.first,
        "every_s": scenario.gnss.every,
        "from_s": from_s,
        "position_sd_m": gnss.sigma_r_n[0].tolist(),
        "velocity_sd_m_s": gnss.sigma_v_n[0].tolist(),
        "start_sd": [start.position, start.velocity, *np.rad2deg([start.level, start.azimuth]).tolist()],
        **{name: model(sensor) for name, sensor in sensors.items()},
    }


def model(sensor):
    """pyins' bias is a random walk: that which grows as ours does at first."""
    walk = sensor.in_run_bias * np.sqrt(2.0 / sensor.in_run_bias_time)
    return {"bias_sd": sensor.bias, "noise": sensor.random_walk, "bias_walk": walk}


def theirs(job, threads):
    """What the worker prints.

    threads : environment that limits them
    """
    python = environment(PEER, print)
    environ = {**os.environ, **threads}
    environ.pop("PYTHONPATH", None)  # it would bring our packages into theirs
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "task.json"
        path.write_text(json.dumps(job))
        script = Path(__file__).parent / "peers" / PEER.worker
        done = subprocess.run(
            [str(python), str(script), str(path)], env=environ, stdout=subprocess.PIPE, text=True, check=True
        )
    return json.loads(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("data", type=Path, help="folder with NaveGo's three files")
    parser.add_argument("--from", dest="from_s", type=float, default=60.0)
    given = parser.parse_args()
    from shefex_nav.replay import load

    path = SCENARIOS / "replay" / "navego.yaml"
    scenario, files = load.load(path, [], given.data)
    here = ours(scenario, files, given.from_s)
    alike = ours(load.load(path, ITS_STEP, given.data)[0], files, given.from_s)
    job = task(scenario, files, given.from_s)
    there, as_installed = theirs(job, ONE_THREAD), theirs(job, {})
    ratios = []
    for kind in FIGURES:
        two = [np.array(one[kind]) / there[kind] for one in (here, alike)]
        ratios.append(two)
        columns = [" ".join(f"{value:6.3f}" for value in row) for row in (here[kind], there[kind], *two)]
        words = "here {}   pyins {}   ratio {}, with its step {}".format(*columns)
        print(f"{kind:9} [{UNITS[kind]}]".ljust(17), words)
    print("error over sigma: here {:.2f} to {:.2f}".format(*ends(here["over_sigma"].values())), end=", ")
    print("pyins {:.2f} to {:.2f}".format(*ends(there[f"{kind}_over_sigma"] for kind in FIGURES)))
    speed = {name: there["data_s"] / run["process_s"] for name, run in
             (("ticks", here), ("step", alike), ("pyins", there))}  # fmt: skip
    faster = speed["step"] / speed["pyins"]
    print(
        f"times real time, one thread: with its step {speed['step']:.0f}, pyins {speed['pyins']:.1f}: "
        f"{faster:.0f} times faster; with the ticks of the scenario {speed['ticks']:.0f}"
    )
    print(f"pyins as it comes, wall clock: {there['data_s'] / as_installed['wall_s']:.1f} times real time")
    worst, mean = np.max(ratios), np.mean(ratios, axis=(0, 2)).max()  # of the two, the worse mean
    met = worst <= WITHIN and mean <= 1.0 and faster >= TIMES
    print(f"largest ratio {worst:.2f}, mean {mean:.2f}:", "met" if met else "NOT met")
    raise SystemExit(0 if met else 1)


def ends(rows):
    """Smallest and largest of some rows of numbers."""
    values = [value for row in rows for value in row]
    return min(values), max(values)


if __name__ == "__main__":
    main()
