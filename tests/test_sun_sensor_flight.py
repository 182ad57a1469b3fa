"""A Sun sensor flies in a mission: its innovations are as large as the filter says, used or not."""

import numpy as np

from shefex_nav import prepare, simulate
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.records import GateResult
from shefex_nav.scenario.load import file_of, load

TEXT = """# Sun.
extends: rexus_like.yaml
mission: {name: sun}
navigation: {states: automatic}
sun_sensor: {rate: 10 Hz, boresight: [0, 1, 0], field_of_view: 90 deg, noise: 0.2 deg, alignment: 0.1 deg}
"""


def flown(path, sets=(), until_s=30.0, seed=1):
    scenario = load(file_of(str(path)), sets)
    world = prepare.build_world(scenario, seed)
    mission = prepare.mission(scenario, seed, world.flight.trajectory)
    records = list(simulate.route(world, scenario, seed, until_s=until_s))
    return mission, records


def test_innovations_are_as_large_as_the_filter_says(tmp_path):
    (tmp_path / "sun.yaml").write_text(TEXT)
    _, records = flown(tmp_path / "sun.yaml")
    gates = [one for one in records if isinstance(one, GateResult) and one.sensor == "sun_sensor"]
    assert len(gates) > 100 and all(one.accepted and one.dof == 2 for one in gates)
    assert abs(np.mean([one.nis for one in gates]) - 2.0) < 4.0 * np.sqrt(4.0 / len(gates))


def test_what_is_aboard_and_not_used_has_no_states(tmp_path):
    (tmp_path / "sun.yaml").write_text(TEXT)
    for path, name in ((tmp_path / "sun.yaml", "sun_sensor"), ("baro_2d_gps", "barometer")):
        mission, records = flown(path, [f"navigation.{name}.used=false"], until_s=2.0)
        builder = RunDataBuilder(mission)
        for record in records:
            builder.add(record)
        data = builder.build()
        assert len(data.readings[name].t_valid_s) > 10
        assert not any(gate.sensor == name for gate in data.gates)
        assert not {"sun_alignment", "baro_bias"} & set(data.covariance.states[-1].split())
