"""Parts of a phase are named by the tasks that steer in it."""

from shefex_nav.records import Event, Phase
from shefex_nav.report.figures.style import steered


def events(*named):
    """Event records of (name, s)."""
    return [Event(t_s=t_s, name=name, detail="", altitude_m=0.0) for name, t_s in named]


def test_tasks_divide_a_phase_and_gaps_have_its_name():
    """One task ends before the next begins; the second begins with the phase of the third."""
    told = events(
        ("point_start", 20.0), ("point_end", 39.0), ("burn_out_1", 25.0), ("r_05_start", 39.0),
        ("r_05_end", 58.0), ("back_start", 60.0), ("back_end", 90.0),
    )  # fmt: skip
    assert steered(told, Phase.POINTING, 20.0, 90.0) == [
        ("point", 20.0, 39.0), ("r 05", 39.0, 60.0), ("back", 60.0, 90.0),
    ]  # fmt: skip
    assert steered(told, Phase.POINTING, 58.0, 60.0) == [("pointing", 58.0, 60.0)]
    assert steered([], Phase.MANOEUVRE, 1.0, 2.0) == [("manoeuvre", 1.0, 2.0)]
    assert steered(told, Phase.COAST, 20.0, 90.0) == [("coast", 20.0, 90.0)]
