"""The vehicles of the check-cases as small DAVE-ML models: their figures, not their files.

Figures: cannonball_*.dml, brick_*.dml and twostage_*.dml of the NESC check-cases (E. B. Jackson, NASA
Langley, 2012 to 2014), as in github.com/nasa/simupy-flight, NESC_data/All_models.
"""

HEAD = '<DAVEfunc xmlns="http://daveml.org/2010/DAVEML">'
MATH = '<calculation><math xmlns="http://www.w3.org/1998/Math/MathML">{}</math></calculation>'


def defined(identifier, *, units="nd", inside="", **attributes):
    """A variable."""
    more = "".join(f' {name}="{value}"' for name, value in attributes.items())
    named = f'varID="{identifier}" name="the {identifier}" units="{units}"{more}'
    return f"<variableDef {named}>{inside}</variableDef>"


def calculated(identifier, expression, **attributes):
    """A variable with a calculation."""
    return defined(identifier, inside=MATH.format(expression), **attributes)


def applied(operator, *arguments):
    """A MathML operator and its arguments."""
    return f"<apply><{operator}/>{''.join(arguments)}</apply>"


def ci(name):
    """A MathML variable."""
    return f"<ci> {name} </ci>"


def cn(value):
    """A MathML number."""
    return f"<cn>{value!r}</cn>"


def piecewise(condition, then, otherwise):
    """A MathML choice of two."""
    return f"<piecewise><piece>{then}{condition}</piece><otherwise>{otherwise}</otherwise></piecewise>"


def constants(units, **values):
    """Variables of constant value."""
    return "".join(defined(name, units=units, initialValue=repr(value)) for name, value in values.items())


def table(argument, result, points, values):
    """A function of one variable, held constant beyond its ends."""
    points, values = (", ".join(map(str, numbers)) for numbers in (points, values))
    return (
        f'<breakpointDef bpID="{result}_at"><bpVals>{points}</bpVals></breakpointDef>'
        f'<function name="{result}"><independentVarRef varID="{argument}"/>'
        f'<dependentVarRef varID="{result}"/><functionDefn><griddedTableDef>'
        f'<breakpointRefs><bpRef bpID="{result}_at"/></breakpointRefs>'
        f"<dataTable>{values}</dataTable></griddedTableDef></functionDefn></function>"
    )


def write(folder):
    """Write all models into a folder; returns it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, body in _bodies().items():
        (folder / f"{name}.dml").write_text(f"{HEAD}{body}</DAVEfunc>", encoding="utf-8")
    return folder


def _bodies():
    none = constants("slugft2", XIXY=0.0, XIZX=0.0, XIYZ=0.0) + constants("ft", DXCG=0.0, DYCG=0.0, DZCG=0.0)
    # the area has a name of its own in the models
    area = '<variableDef varID="SWING" name="referenceWingArea" units="ft2" initialValue="{}"/>'
    chord = '<variableDef varID="CBAR" name="referenceWingChord" units="ft" initialValue="0.66667"/>'
    span = '<variableDef varID="BSPAN" name="referenceWingSpan" units="ft" initialValue="0.33333"/>'
    drag = '<variableDef varID="CD" name="totalCoefficientOfDrag" units="nd" initialValue="{}"/>'
    rates = "".join(defined(name, units="rad_s") for name in ("PB", "QB", "RB"))
    damping = "".join(
        calculated(moment, applied("divide", applied("times", cn(-0.5), ci(rate), ci(length)), ci("VRW")))
        for moment, rate, length in (("Cl", "PB", "BSPAN"), ("Cm", "QB", "CBAR"), ("Cn", "RB", "BSPAN"))
    )
    return {
        "cannonball_inertia": constants("slugft2", XIXX=3.6, XIYY=3.6, XIZZ=3.6)
        + constants("slug", XMASS=1.0)
        + none,
        "cannonball_aero": area.format(0.1963495) + drag.format(0.1),
        "brick_inertia": constants("slugft2", XIXX=0.00189422, XIYY=0.006211019, XIZZ=0.007194665)
        + constants("slug", XMASS=0.155404754)
        + none,
        "brick_aero": area.format(0.22222) + chord + span + defined("VRW", units="ft_s") + rates + damping,
        "twostage_inertia": _rocket_inertia(),
        "twostage_aero": _rocket_aero(),
        "twostage_prop": _rocket_propulsion(),
    }


def _rocket_inertia():
    staged = applied("gt", ci("stagedFlag"), cn(0.0))
    given = defined("stagedFlag") + defined("stg1fuelUsed", units="kg") + defined("stg2fuelUsed", units="kg")
    given += constants("kg", stg1maxFuel=180e3, stg2maxFuel=80e3)

    def falling(full, empty, used, most):
        share = applied("divide", ci(used), ci(most))
        return applied("plus", cn(full), applied("times", cn(empty - full), share))

    def both(identifier, units, first, second):
        pieces = (
            falling(*second, "stg2fuelUsed", "stg2maxFuel"),
            falling(*first, "stg1fuelUsed", "stg1maxFuel"),
        )
        return calculated(identifier, piecewise(staged, *pieces), units=units)

    pitch = (33501637.473461, 10886636.572139), (941063.762626, 212384.868421)
    return (
        given
        + both("XMASS", "kg", (314e3, 134e3), (99e3, 19e3))
        + both("vrsPositionOfCM_X", "m", (16.91879, 9.421642), (4.79798, 3.947368))
        + both("XIXX", "kgm2", (353250.0, 150750.0), (111375.0, 21375.0))
        + both("XIYY", "kgm2", *pitch)
        + both("XIZZ", "kgm2", *pitch)
        + calculated("vrsPositionOfMrc_X", piecewise(staged, cn(4.79798), cn(16.91879)), units="m")
    )


def _rocket_aero():
    angles = range(-10, 11, 2)
    lift = (-1.6, -1.0, -0.73, -0.49, -0.24, 0, 0.24, 0.49, 0.73, 1.0, 1.6)
    drag = (0.48, 0.38, 0.31, 0.25, 0.23, 0.21, 0.23, 0.25, 0.31, 0.38, 0.48)
    names = ("beta", "totalCoefficientOfLift", "totalCoefficientOfDrag", "aeroBodyMomentCoefficient_Pitch")
    return (
        defined("alpha", units="deg")
        + "".join(map(defined, names))
        + constants("m", cbar=3.0, bspan=3.0)
        + table("alpha", "totalCoefficientOfLift", angles, lift)
        + table("alpha", "totalCoefficientOfDrag", angles, drag)
        + table("alpha", "aeroBodyMomentCoefficient_Pitch", (-20, 0, 20), (0.6, 0, -0.6))
    )


def _rocket_propulsion():
    second = applied("gt", ci("stg2firing"), cn(0.0))
    flow = applied("divide", ci("thrust"), applied("times", ci("isp"), cn(9.8066)))
    return (
        defined("stg1firing")
        + defined("stg2firing")
        + calculated("thrust", piecewise(second, cn(5e6), cn(17e6)), units="N")
        + calculated("isp", piecewise(second, cn(390.0), cn(360.0)), units="sec")
        + calculated("mdot", flow, units="kg_s")
    )
