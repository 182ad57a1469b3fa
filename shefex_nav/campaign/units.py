"""Units of what a campaign draws, from the scenario that its folder keeps."""

from shefex_nav.errors import UserError


def dispersed(source, name):
    """disperse.Dispersed of a scenario, YAML text: list.

    Nothing of a scenario that cannot be read: a table is worth having without.
    """
    from shefex_nav.scenario import load

    try:
        return load.Pattern(source, name).dispersed
    except UserError:
        return []


def of_source(source, name):
    """{path as written: unit} of the dispersions of a scenario; '' without, 'times' of a factor."""
    return {one.name: one.measure for one in dispersed(source, name)}


def numbers(given):
    """Paths of the dispersions, list of Dispersed, that draw numbers whatever the run: list."""
    from shefex_nav.scenario import laws

    return [one.name for one in given if not isinstance(one.law, laws.ChoiceLaw | laws.TableLaw)]
