"""What `dispersions` accepts of a scenario a run can set; what no run could set is refused."""

from typing import get_origin

import pytest
from broken import DEFAULT, SCENARIO_FOLDER, the_message

from shefex_nav.scenario import disperse, fields, layers, load, messages
from shefex_nav.scenario.quantity import QuantitySpec

PROBABILITIES = 0.2, 0.9, 0.05, 0.6  # one of which must give a run that flies
EVERY = 20  # leaf is tried, all of them with -m slow


def leaves(model, tree):
    """Paths of all single values and lists that a scenario has, defaults among them: iterator."""

    def walk(annotation, metadata, node, path):
        annotation, metadata = fields.chosen_form(*messages.bare(annotation, metadata), node)
        if messages.is_model(annotation):
            inner = annotation.keys()
        elif get_origin(annotation) is dict:
            inner = node
        else:
            yield path
            inner = range(len(node)) if isinstance(node, list | tuple) else ()
        for key in inner:
            try:
                below = fields._step(annotation, node, key, path)
            except fields.NoField:  # not given
                continue
            yield from walk(*below, (*path, key))

    return walk(model, (), tree, ())


def small(target):
    """A dispersion that changes a value by little, as it is written."""
    if target.spec is None:
        return {"choice": [target.nominal]}
    unit = target.spec.unit if isinstance(target.spec, QuantitySpec) else ""
    is_ratio = isinstance(target.spec, QuantitySpec) and not unit
    return {"normal": "1e-6 %" if is_ratio else f"1e-6 {unit}" if unit else 1e-6}


def tried(path, first=0, every=1):
    """(number accepted, names of those refused, {name: words} of those accepted that no run can set)."""
    scenario = load.load(path)
    text, accepted, refused, unfit = scenario.source, 0, [], {}
    tree = layers.parsed(text, "text").tree
    for one in [*leaves(type(scenario), tree)][first::every]:
        name = ".".join(map(str, one))
        if one[0] in disperse.OWN:
            continue
        target = fields.target(type(scenario), tree, name)
        try:
            made = load.Pattern(load.normalised(tree | {"dispersions": {name: small(target)}}), "text")
        except load.ScenarioError as error:
            refused.append(name)
            assert error.messages[0].startswith("text:") and f": dispersions.{name}" in error.messages[0]
            continue
        accepted += 1
        (law,) = (dispersed.law for dispersed in made.dispersed)
        unfit |= {name: words} if (words := complaint(made, name, law)) else {}
    return accepted, refused, unfit


def complaint(made, name, law):
    """What every run says of a pattern with one dispersion; '' if one flies."""
    words = ""
    for u in PROBABILITIES:
        try:
            made.with_draws({name: law.draw(u, 0)})
        except load.ScenarioError as error:
            words = str(error)
        else:
            return ""
    return words


def test_what_dispersions_accept_a_run_can_set():
    accepted, _, unfit = tried(DEFAULT, every=EVERY)
    assert accepted > 20 and not unfit


@pytest.mark.slow
@pytest.mark.parametrize("name", ["shefex2_andoya", "imu_faults", "rexus_like", "orbit"])
def test_what_dispersions_accept_a_run_can_set_anywhere(name):
    accepted, refused, unfit = tried(SCENARIO_FOLDER / f"{name}.yaml")
    assert accepted > 200 and not unfit and len(refused) < 0.15 * accepted, refused


UNFIT = {  # dispersion: what every run says
    "star_camera.mounting.boresight.0: {normal: 0.01}": (
        "star_camera.mounting.image_right: must be at right angles to boresight, is at 8"),
    "gps.rate: {normal: 0.01 Hz}": "gps.rate: 1.0",
    "log.rate: {log_normal: 1 %}": "log.rate: 10",
    "programme.slew.until: {uniform: [0.1 s, 1 s]}": "programme.pointing.from: 250 s is before the end of",
    "star_tracker.exposure.start: {table: [51 ms, 52 ms]}": "star_tracker.exposure.start: 51 ms must lie",
}  # fmt: skip


@pytest.mark.parametrize("dispersion", UNFIT)
def test_what_no_run_could_set_is_refused_where_it_stands(dispersion, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: {DEFAULT}\ndispersions:\n  {dispersion}\n", encoding="utf-8")
    name = dispersion.partition(": ")[0]
    words = f"dispersions.{name}: every run would refuse what is drawn: {UNFIT[dispersion]}"
    column = len(name) + 5
    assert the_message(path).startswith(f"{path}:3:{column}: {words}")


def test_the_kind_of_a_fault_cannot_be_drawn_without_what_it_needs():
    kinds = "dispersions.faults.imu.0.fault={choice: [gyro_scale, gyro_bias]}"
    said = the_message(SCENARIO_FOLDER / "imu_faults.yaml", [kinds])
    assert "every run would refuse what is drawn: faults.imu.0.axis: is missing" in said


def test_values_that_go_together_are_tried_together():
    together = ("slew.until={table: [252 s, 251 s]}", "pointing.from={table: [253 s, 252 s]}")
    load.load(DEFAULT, [f"dispersions.programme.{one}" for one in together])
    load.load(DEFAULT, ["dispersions.star_tracker.exposure.start={normal: 1 ms}"])  # every other run flies
