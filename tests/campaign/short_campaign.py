"""A mission short enough to be flown many times in a test: instruments at rest for two seconds."""

from concurrent.futures import Future
from pathlib import Path

from shefex_nav.campaign import engine, running
from shefex_nav.campaign.flight import Pilot
from shefex_nav.campaign.progress import Show
from shefex_nav.campaign.store import Store

NIGHT_SKY = Path(__file__).parents[2] / "scenarios" / "night_sky.yaml"
TEXT = f"""
extends: {NIGHT_SKY}
mission: {{name: short, time_limit: 2 s}}
star_tracker: {{enabled: false, off: 2 s}}
campaign: {{series: 2 Hz}}
dispersions:
  ground.latitude: {{uniform: [-1 deg, 1 deg]}}
  imu.gyro.bias: {{log_normal: 20 %}}
  imu.accelerometer.bias: {{normal: 5 %, apply: scale}}
"""
BREAKS = """  vehicle.payload.mass: {table: {file: mass.csv, column: mass_kg, unit: kg}}
"""  # a payload heavier than the world may be


class HereLane:
    """Flies in this process, at once."""

    capacity = 1

    def __init__(self, plan, before=lambda job: None):
        self._pilot, self._before = Pilot(plan), before
        self.renewed = 0

    def submit(self, job):
        """Future that is done."""
        future = Future()
        try:
            self._before(job)
            future.set_result(self._pilot.fly(job))
        except Exception as error:
            future.set_exception(error)
        return future

    def renew(self):
        self.renewed += 1

    def stop(self, at_once=False):
        pass


def write(folder, more="", text=TEXT):
    """Path of the scenario in a folder."""
    path = folder / "short.yaml"
    path.write_text(text + more)
    return path


def request(scenario, runs=4, **kept):
    """Request of a loaded scenario."""
    wanted = {"workers": 1, "cluster": None, "keep": ()} | kept
    return running.Request(scenario, runs, wanted.pop("seed", 1), **wanted)


def fly(scenario, folder, runs=4, stopped=lambda: False, before=lambda job: None, say=lambda t: None, **kept):
    """The campaign in this process. -> Ended"""
    with Store(folder) as store:
        return running.fly(
            request(scenario, runs, **kept),
            store,
            Show(say),
            stopped,
            crew=lambda plan, count: [HereLane(plan, before)],
        )


__all__ = ["BREAKS", "TEXT", "HereLane", "engine", "fly", "request", "write"]
