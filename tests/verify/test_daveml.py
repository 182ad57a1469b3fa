"""The reader of DAVE-ML, with small models written for these tests."""

import math

import pytest
from small_models import HEAD, applied, calculated, ci, cn, defined

from shefex_nav.verify import daveml


@pytest.fixture
def model(tmp_path):
    """model(body) -> Model of a file with that body."""

    def make(body):
        path = tmp_path / "model.dml"
        path.write_text(f"{HEAD}{body}</DAVEfunc>", encoding="utf-8")
        return daveml.read(path)

    return make


def tabled(values, points="0, 1, 3", **attributes):
    more = "".join(f' {name}="{value}"' for name, value in attributes.items())
    return (
        f'<breakpointDef bpID="B"><bpVals>{points}</bpVals></breakpointDef>'
        f'<function name="f"><independentVarRef varID="x"{more}/><dependentVarRef varID="y"/><functionDefn>'
        '<griddedTableDef><breakpointRefs><bpRef bpID="B"/></breakpointRefs>'
        f"<dataTable><!-- remark, 7 -->{values}</dataTable></griddedTableDef></functionDefn></function>"
    )


XY = defined("x") + defined("y")


def test_values_come_in_si_units_by_identifier_or_name(model):
    body = model(
        defined("A", units="slugft2", initialValue="3.6") + defined("B", units="deg", initialValue="90")
    )
    assert daveml.evaluate(body, "A") == pytest.approx(3.6 * 1.35581795, rel=1e-8)  # kg m^2
    assert daveml.evaluate(body, "the B") == pytest.approx(math.pi / 2.0)


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        (applied("plus", cn(1), cn(2), cn(4)), 7.0),
        (applied("minus", cn(1), cn(4)), -3.0),
        (applied("minus", cn(4)), -4.0),
        (applied("times", cn(2), cn(3), cn(4)), 24.0),
        (applied("divide", cn(1), cn(4)), 0.25),
        (applied("quotient", cn(9), cn(4)), 2.0),
        (applied("power", applied("plus", cn(9), cn(16)), cn(0.5)), 5.0),
        (applied("abs", applied("minus", cn(2))), 2.0),
        (applied("sin", applied("divide", "<pi/>", cn(6))), 0.5),
    ],
)
def test_arithmetic(model, expression, value):
    assert daveml.evaluate(model(calculated("y", expression)), "y") == pytest.approx(value)


@pytest.mark.parametrize(
    ("operator", "below", "at", "above"),
    [("gt", 0, 0, 1), ("geq", 0, 1, 1), ("lt", 1, 0, 0), ("leq", 1, 1, 0), ("eq", 0, 1, 0), ("neq", 1, 0, 1)],
)
def test_pieces_hold_where_their_condition_does(model, operator, below, at, above):
    pieces = f"<piece>{cn(1)}{applied(operator, ci('x'), cn(5))}</piece><otherwise>{cn(0)}</otherwise>"
    body = model(defined("x") + calculated("y", f"<apply><piecewise>{pieces}</piecewise></apply>"))
    assert [daveml.evaluate(body, "y", x=x) for x in (4.0, 5.0, 6.0)] == [below, at, above]


def test_the_piece_that_does_not_hold_is_not_evaluated(model):
    division = applied("divide", cn(1), ci("x"))
    pieces = f"<piece>{cn(7)}{applied('eq', ci('x'), cn(0))}</piece><otherwise>{division}</otherwise>"
    body = model(defined("x") + calculated("y", f"<piecewise>{pieces}</piecewise>"))
    assert daveml.evaluate(body, "y", x=0.0) == 7.0
    assert daveml.evaluate(body, "y", x=4.0) == 0.25


def test_calculations_lean_on_each_other_in_any_order(model):
    body = calculated("z", applied("times", ci("y"), ci("y"))) + calculated(
        "y", applied("plus", ci("x"), cn(1))
    )
    assert daveml.evaluate(model(body + defined("x", initialValue="2")), "z") == 9.0
    assert daveml.evaluate(model(body + defined("x", initialValue="2")), "z", x=3.0) == 16.0


@pytest.mark.parametrize(
    ("attributes", "below", "above"),
    [
        ({}, 10.0, 50.0),
        ({"extrapolate": "both"}, 0.0, 65.0),
        ({"extrapolate": "min"}, 0.0, 50.0),
        ({"extrapolate": "max"}, 10.0, 65.0),
        ({"extrapolate": "both", "min": "-0.5", "max": "3.5"}, 5.0, 57.5),
    ],
)
def test_tables_end_as_they_say(model, attributes, below, above):
    body = model(XY + tabled("10, 20, 50", **attributes))
    found = [daveml.evaluate(body, "y", x=x) for x in (-1.0, 0.5, 2.0, 4.0)]
    assert found == pytest.approx([below, 15.0, 35.0, above])


def test_the_limits_of_a_variable_hold(model):
    body = model(
        defined("x", minValue="0.5", maxValue="2") + calculated("y", applied("times", cn(10), ci("x")))
    )
    assert [daveml.evaluate(body, "y", x=x) for x in (0.0, 1.0, 3.0)] == [5.0, 10.0, 20.0]


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (calculated("y", applied("plus", ci("y"), cn(1))), "depends on itself"),
        (calculated("y", ci("x")) + defined("x"), "x is an input and was not given"),
        (calculated("y", applied("erf", cn(1))), "<erf>"),
        (calculated("y", applied("divide", cn(1), cn(0))), "cannot be calculated"),
        (defined("y", units="furlong", initialValue="1"), "furlong"),
        (defined("z"), "no variable y"),
        (calculated("y", applied("ln", cn(-1))), "y cannot be calculated"),
        (
            calculated("y", "<cn>1_0</cn>"),
            "y cannot be calculated: expected a number .* got '1_0'",
        ),
        (calculated("y", "<cn/>"), "y cannot be calculated: expected a number such as 12.5, got nothing"),
        (calculated("y", "<piecewise><piece/></piecewise>"), "y cannot be calculated"),
        (calculated("y", applied("times", cn(1e300), cn(1e300))), "y cannot be calculated: it becomes inf"),
    ],
)
def test_what_cannot_be_evaluated_is_refused(model, body, message):
    with pytest.raises(daveml.DaveMlError, match=message):
        daveml.evaluate(model(body), "y")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (XY + tabled("1, 2"), "as many values"),
        (XY + tabled("1, 2, 3", points="0, 3, 1"), "increasing"),
        (XY + tabled("1, 2, 3", interpolate="cubicSpline"), "linear"),
        (defined("y", initialValue="(2/5)"), "y: initialValue"),
        ("<variableDef/>", "varID is missing"),
        ('<breakpointDef bpID="p"/>', "p: has 0 <bpVals>, expected one"),
        (
            XY
            + tabled("1, 2, 3").replace("<dependentVarRef", '<independentVarRef varID="x"/><dependentVarRef'),
            "one",
        ),
    ],
)
def test_what_cannot_be_read_is_refused(model, body, message):
    with pytest.raises(daveml.DaveMlError, match=message):
        model(body)


def test_another_file_is_refused(tmp_path):
    path = tmp_path / "model.dml"
    path.write_text("<html/>", encoding="utf-8")
    with pytest.raises(daveml.DaveMlError, match="<html>"):
        daveml.read(path)
    with pytest.raises(daveml.DaveMlError, match="cannot be read"):
        daveml.read(tmp_path / "absent.dml")


def test_the_rocket_models_say_what_their_notes_say(nesc_data):
    """The notes beside them: 17 MN and 360 s, 5 MN and 390 s; 35 + 180 + 15 + 80 + 4 t; 3 m and 7 m^2."""
    models = nesc_data / "models"
    propulsion = daveml.read(models / "twostage_prop.dml")
    for stage, force, impulse_s in (("stg1firing", 17e6, 360.0), ("stg2firing", 5e6, 390.0)):
        flags = {"stg1firing": 0.0, "stg2firing": 0.0} | {stage: 1.0}
        assert daveml.evaluate(propulsion, "thrust", **flags) == force
        assert daveml.evaluate(propulsion, "mdot", **flags) == pytest.approx(force / impulse_s / 9.8066)
    inertia = daveml.read(models / "twostage_inertia.dml")
    used = {"stg1fuelUsed": 90e3, "stg2fuelUsed": 20e3}
    assert daveml.evaluate(inertia, "totalMass", stagedFlag=0.0, **used) == 224e3
    assert daveml.evaluate(inertia, "totalMass", stagedFlag=1.0, **used) == 79e3
    aero = daveml.read(models / "twostage_aero.dml")
    assert (daveml.evaluate(aero, "sref"), daveml.evaluate(aero, "cbar")) == (7.0, 3.0)
    assert daveml.evaluate(aero, "liftCoefficient", alpha=-3.0, beta=0.0) == pytest.approx(-0.365)
    assert daveml.evaluate(aero, "dragCoefficient", alpha=3.0, beta=4.0) == pytest.approx(0.28)
    assert daveml.evaluate(aero, "pitchingMomentCoefficient", alpha=30.0, beta=0.0) == -0.6
