"""What holds of every instrument that comes with the program, and of what follows from its object."""

import ast
from dataclasses import replace
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest
import synthetic_trajectory

from shefex_nav import instruments
from shefex_nav.geometry import rotation
from shefex_nav.instruments.instrument import Known, Truth
from shefex_nav.log import topics
from shefex_nav.onboard.navigation.aiding import Here
from shefex_nav.onboard.navigation.state import N_NOMINAL, NavState, corrected, layout, pack
from shefex_nav.scenario.of_settings import section, settings
from shefex_nav.world import noise

SUN_I = rotation.dcm_from_quat(synthetic_trajectory.fly(end_s=1.0).q_ib[0]) @ np.array([0.6, 0.0, -0.8])
GIVEN = {
    "barometer": {"rate": "10 Hz", "bias": "100 Pa", "noise": "5 Pa", "lag": "30 ms"},
    "magnetometer": {"rate": "10 Hz", "hard_iron": "500 nT", "noise": "50 nT"},
    "sun_sensor": {
        **{"rate": "20 Hz", "boresight": [0, 1, 0], "field_of_view": "80 deg"},
        **{"noise": "0.1 deg", "alignment": "0.1 deg"},
    },
}
STEPS = {"position": 20.0, "velocity": 1e-2, "attitude": 1e-5, "baro_bias": 1.0, "baro_scale": 1e-4}
STEPS |= {"hard_iron": 1e-8, "sun_alignment": 1e-4}
EACH = pytest.mark.parametrize("one", list(instruments.BUILT_IN.values()), ids=list(instruments.BUILT_IN))


def settings_of(one):
    return settings(section(one.settings).model_validate(GIVEN[one.name]))


def use_of(one):
    return settings(section(one.use)())


@pytest.fixture(scope="module")
def flight():
    return synthetic_trajectory.fly(end_s=20.0)


def measured(one, flight, seed=1, **changes):
    truth = Truth(flight, synthetic_trajectory.EARTH, 2012.5, SUN_I, np.zeros((0, 4)))
    stream = noise.key_of(one.name) if one.stream is None else one.stream
    return one.measure(replace(settings_of(one), **changes), truth, noise.generator(seed, stream)).readings


def aid_of(one):
    return one.aid(settings_of(one), use_of(one), Known(2012.5, SUN_I))


@EACH
def test_readings_come_as_often_and_as_late_as_they_are_said_to(one, flight):
    read = measured(one, flight, latency=0.02)
    t_s = np.array([reading.t_valid_s for reading in read])
    np.testing.assert_allclose(np.diff(t_s), 1.0 / settings_of(one).rate, atol=1e-9)
    np.testing.assert_allclose([reading.t_available_s for reading in read] - t_s, 0.02, atol=1e-12)
    again, other = (np.hstack(measured(one, flight, seed=seed)[250]) for seed in (1, 2))
    np.testing.assert_array_equal(again[2:], np.hstack(read[250])[2:])
    assert not np.array_equal(again, other)


@EACH
def test_the_blocks_of_an_aid_are_those_that_the_table_says(one):
    assert [(block.name, block.size) for block in aid_of(one).blocks] == [
        (s.name, s.size) for s in one.states
    ]
    for block in aid_of(one).blocks:
        assert block.walk.shape == (block.size,)
        assert np.linalg.eigvalsh(block.P).min() > 0.0


@EACH
@pytest.mark.parametrize("seed", range(3))
def test_jacobians_are_what_perturbing_the_state_gives(one, seed, flight):
    aid = aid_of(one)
    order = layout([block.name for block in aid.blocks], aid.blocks)
    held = [reading for reading in measured(one, flight) if aid.holds is None or aid.holds(reading)]
    rng, reading = np.random.default_rng(seed), held[5 + 20 * seed]
    k = int(np.argmin(np.abs(flight.t_s - reading.t_valid_s)))
    others = np.concatenate([np.empty(0), *(0.1 * np.sqrt(np.diag(block.P)) for block in aid.blocks)])
    q_ib = flight.q_ib[k] + 1e-3 * rng.standard_normal(4)
    motion = flight.r_i[k], flight.v_i[k], q_ib / np.linalg.norm(q_ib), np.zeros(3), np.zeros(3)
    x = pack(NavState(flight.t_s[k], *motion, others=others))
    assert len(x) == N_NOMINAL + len(others)

    def seen(e):
        return aid.expect(
            Here(order, synthetic_trajectory.EARTH, flight.t_s[k], corrected(x, e, order.nominal)), reading
        )

    H = seen(np.zeros(order.n)).H
    for name, place in order.places.items():
        for j in range(place.start, place.stop) if place is not None and name in STEPS else ():
            e = np.zeros(order.n)
            e[j] = STEPS[name]
            numeric = (seen(-e).z - seen(e).z) / (2.0 * STEPS[name])
            np.testing.assert_allclose(
                H[:, j], numeric, rtol=5e-3, atol=5e-3 * np.abs(H).max(), err_msg=f"{name} {j}"
            )


@EACH
def test_the_topic_has_every_field_with_its_unit(one):
    topic = topics.of_record(one.record)
    assert topic.topic == f"/{one.name}"
    assert [field.source for field in topic.fields] == list(one.record._fields)
    for field in topic.fields[2:]:
        (column,) = get_type_hints(one.record, include_extras=True)[field.source].__metadata__
        assert (f"[{column.unit}]" in field.comment) == bool(column.unit)


@EACH
def test_plots_have_a_value_for_each_reading(one, flight):
    from shefex_nav.log.run_data import stack

    read = stack(one.record, measured(one, flight))
    for plot in one.plots:
        assert plot.values(read).shape in {(len(read.t_valid_s),), (len(read.t_valid_s), 3)}


def names_in(function, functions, seen):
    """Names of modules that a function of a file uses, through the functions of the file that it calls."""
    if function in seen or function not in functions:
        return set()
    seen.add(function)
    used = {node.id for node in ast.walk(functions[function]) if isinstance(node, ast.Name)}
    modules = {
        node.module
        for node in ast.walk(functions[function])
        if isinstance(node, ast.ImportFrom) and node.module
    }
    for name in used:
        modules |= names_in(name, functions, seen)
    return modules


@EACH
def test_the_wall_stands_in_a_file_that_has_both_halves(one):
    """Nothing that `measure` reaches is on board, nothing that `aid` reaches is of the world."""
    path = Path(instruments.__file__).parent / f"{one.name}.py"
    tree = ast.parse(path.read_text())
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    world, onboard = (names_in(name, functions, set()) for name in ("measure", "aid"))
    assert not any(module.startswith("shefex_nav.onboard") for module in world)
    assert not any(module.startswith("shefex_nav.world") for module in onboard)
    top = {node.module for node in tree.body if isinstance(node, ast.ImportFrom) and node.module}
    assert not any(module.startswith("shefex_nav.world") for module in top)
    assert {module for module in top if module.startswith("shefex_nav.onboard")} == {
        "shefex_nav.onboard.navigation.aid"
    }
