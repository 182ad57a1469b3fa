"""Units of what a campaign draws, from the scenario that its folder keeps."""

from shefex_nav.errors import UserError


def of_source(source, name):
    """{path as written: unit} of the dispersions of a scenario, YAML text; '' without, 'times' of a factor.

    Nothing of a scenario that cannot be read: a table is worth having without.
    """
    from shefex_nav.scenario import load

    try:
        return {one.name: one.measure for one in load.Pattern(source, name).dispersed}
    except UserError:
        return {}
