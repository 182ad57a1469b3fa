"""What `compare` says of the measurements of each sensor: used, refused, NIS."""

from pathlib import Path

import keeping
import numpy as np
import pytest

from shefex_nav import runs
from shefex_nav.campaign.compare import comparison, paired, parts, sides, summary
from shefex_nav.campaign.compare.quantities import NEARER, NEES, NEITHER
from shefex_nav.report import innovations, metrics
from shefex_nav.scenario.load import load

STARS, RUNS = "star_tracker", 3


@pytest.fixture(scope="module")
def flown():
    """RunData of a flight with GPS and stars."""
    return runs.fly(load("night_sky"), until_s=6.0).data


def refusing(data):
    """The same, as if every other star fix had been refused, for innovations that are twice as large."""
    gates, n = [], 0
    for one in data.gates:
        if one.sensor == STARS and one.dof:
            n += 1
            one = one._replace(accepted=n % 2 == 0, nis=4.0 * one.nis)
        gates.append(one)
    return data._replace(gates=gates)


def logs(*several):
    return [
        sides._of_data(Path(f"{letter}.mcap"), data, letter, letter)
        for letter, data in zip("AB", several, strict=True)
    ]


def rows_of(found):
    return {row.quantity.name: row for row in found.rows}


def test_used_refused_and_nis_are_those_of_the_summary(flown):
    a, b = logs(flown, refusing(flown))
    found = comparison.compare(a, b)
    rows, of_b = rows_of(found), metrics.summarise(refusing(flown))["navigation"]
    counts = of_b["measurements"][STARS]
    assert rows["star fixes, used"].b.median == counts["used"] < rows["star fixes, used"].a.median
    share = 100.0 * counts["refused"] / (counts["used"] + counts["refused"])
    assert rows["star fixes, refused"].b.median == pytest.approx(share) and 45.0 < share < 55.0
    nis = rows["NIS, star fixes, 1 expected"]
    assert nis.b.median == of_b["nis"][STARS]["mean"] / 3.0 == pytest.approx(4.0 * nis.a.median)
    distance = abs(np.log(nis.b.median)) - abs(np.log(nis.a.median))
    assert nis.difference.mean == pytest.approx(distance)
    assert rows["GPS position, refused"].difference.verdict == paired.NOT_SEEN


def test_to_refuse_more_is_neither_better_nor_worse(flown):
    a, b = logs(flown, refusing(flown))
    for side in (a, b):
        (one,) = side.runs.values()
        side.runs.update({seed: one for seed in range(100, 100 + paired.FEW)})
    found = comparison.compare(a, b)
    rows = rows_of(found)
    for name in ("star fixes, used", "star fixes, refused"):
        seen = rows[name].difference
        assert (seen.verdict, seen.better, seen.worse) == (paired.NOT_JUDGED, 0, 0) and seen.mean != 0.0
    cells = {one[0]: one for one in parts._figures(found).rows}
    assert cells["star fixes, refused"][-1] == "not judged: neither good nor bad by itself"
    assert cells["star fixes, refused"][-2] == "-"
    told = summary.summary([a, b], [found])["comparisons"][0]["figures"]
    (one,) = (one for one in told if one["name"] == "star fixes, used")
    assert one["better"] == NEITHER and one["difference"]["verdict"] is None


def test_a_side_whose_nis_is_not_where_it_should_be_is_named(flown):
    lines = parts._figures(comparison.compare(*logs(flown, refusing(flown)))).lines
    (line,) = (line for line in lines if "NIS of" in line)
    assert line.startswith("B, NIS of star fixes") and line.endswith(
        "its innovations are larger than it says"
    )
    nis = metrics.summarise(refusing(flown))["navigation"]["nis"][STARS]
    assert f"{nis['interval'][0] / 3.0:.2f} to {nis['interval'][1] / 3.0:.2f} expected" in line


def test_the_nees_alone_is_called_too_sure(flown):
    """A NIS of 30 is no NEES, however far both are from what they should be."""
    a, b = logs(flown, refusing(refusing(refusing(flown))))
    found = comparison.compare(a, b)
    assert rows_of(found)["NIS, star fixes, 1 expected"].b.median > 30.0
    assert not any("NEES" in line and line.startswith("B,") for line in parts._figures(found).lines)
    assert [row.quantity for row in found.rows if row.quantity.better == NEARER].count(NEES) == 1


def test_errors_that_last_have_a_nis_without_a_verdict(flown):
    gates = [*flown.gates, *(one._replace(sensor="barometer") for one in flown.gates if one.dof)]
    a, b = logs(flown._replace(gates=gates), refusing(flown._replace(gates=gates)))
    row = rows_of(comparison.compare(a, b))["NIS, barometer, below 1 expected"]
    assert row.quantity.better == NEITHER and row.a.median == pytest.approx(1.0, abs=0.5)


def test_fixes_whose_errors_last_in_one_of_the_scenarios_have_none_either(flown):
    a, b = logs(flown, refusing(flown))
    lasting = "gps: {errors: {multipath: {range: 2 m, time: 30 s}}}"
    rows = rows_of(comparison.compare(a, b._replace(source=lasting)))
    assert rows["NIS, GPS position, below 1 expected"].quantity.better == NEITHER
    assert "NIS, star fixes, 1 expected" in rows


def test_a_campaign_has_the_rows_of_its_records(whole):
    folder, _ = whole
    side = sides.of("campaign", folder, "A", "A")
    assert "gps_position" in side.sensors
    rows = rows_of(comparison.compare(side, side))
    kept = [keeping.record(folder, k)["summary"]["navigation"] for k in range(len(side.runs))]
    used = [one["measurements"]["gps_position"]["used"] for one in kept]
    nis = [one["nis"]["gps_position"]["per_dof"] for one in kept]
    assert rows["GPS position, used"].a.median == np.median(used)
    assert rows["NIS, GPS position, 1 expected"].a.median == pytest.approx(np.median(nis))
    get = next(iter(side.runs.values())).get
    low, high = innovations.expected_per_dof(get, "gps_position")
    assert low < 1.0 < high
