"""Every exception of the package is for people, and then a message and exit code 2, or known not to be."""

import importlib
import pkgutil
import sys

import pytest

import shefex_nav
from shefex_nav.commands.app import main
from shefex_nav.errors import UserError

INTERNAL = {  # caught inside the package, which says it in other words, or of the machine
    "campaign.engine.Interrupted",
    "campaign.flight.MachineError",
    "compiled.ahead.CompilerFailed",
    "compiled.signature.UnknownType",
    "environment.yuma.BadYuma",
    "onboard.navigation.blocks.LayoutError",
    "scenario.disperse.Wrong",
    "scenario.document.BadText",
    "scenario.fields.NoField",
    "scenario.files.Unreadable",
    "scenario.partial._Unknown",
    "software.channels.Late",
    "software.channels.Silent",
    "solve.fits_head.FitsError",
    "scenario.tables.BadTable",
    "scenario.tables.NoColumn",
}


@pytest.fixture(scope="module")
def exceptions():
    """Exception classes that modules of the package define: dict by name without the package's."""
    found = {}
    for info in pkgutil.walk_packages(shefex_nav.__path__, "shefex_nav."):
        module = importlib.import_module(info.name)
        for one in vars(module).values():
            if isinstance(one, type) and issubclass(one, Exception) and one.__module__ == info.name:
                found[f"{info.name}.{one.__qualname__}".removeprefix("shefex_nav.")] = one
    return found


def test_every_exception_is_for_people_or_internal(exceptions):
    for_people = {name for name, one in exceptions.items() if issubclass(one, UserError)}
    assert exceptions.keys() - for_people == INTERNAL
    assert {
        "scenario.layers.ScenarioError",
        "world.flight.timeline.FlightError",
        "log.topics.LogError",
    } < for_people


CODES = {"errors.SoftwareError": 3, "runs.flying.LogGoneError": 1}  # of errors that are no bad input


def test_message_and_exit_code_2_from_any_command(exceptions, monkeypatch, capsys):
    words = ["x.yaml:1:1: wrong", "x.yaml:2:1: wrong, too"]
    monkeypatch.setattr(sys, "argv", ["shefex-nav", "schema"])
    for name in sorted(exceptions.keys() - INTERNAL):
        error = exceptions[name](words if name == "scenario.layers.ScenarioError" else "\n".join(words))

        def refuse(error=error):
            raise error

        monkeypatch.setattr("shefex_nav.scenario.json_schema.json_schema", refuse)
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        assert ended.value.code == CODES.get(name, 2), name
        assert (printed.err, printed.out) == ("\n".join(words) + "\n", ""), name


def test_a_fault_of_the_program_keeps_its_traceback(monkeypatch):
    def fail():
        raise ValueError("a fault")

    monkeypatch.setattr("shefex_nav.scenario.json_schema.json_schema", fail)
    monkeypatch.setattr(sys, "argv", ["shefex-nav", "schema"])
    with pytest.raises(ValueError, match="a fault"):
        main()
