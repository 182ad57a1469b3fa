"""What IMPA prints and we read otherwise: each switch against sets, and against what it is to change."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from slow_identify import Sky, angle
from star_fields import MODEL, MULTIPOLE, centroid_list, random_attitude, ready_tracker

from shefex_nav.geometry.shutter import row_times
from shefex_nav.papers.impa import flight, readings
from shefex_nav.papers.impa.methods import as_printed, chain, multipole
from shefex_nav.papers.impa.methods.as_printed import AS_PRINTED, AS_READ, PRINTED
from shefex_nav.papers.verdict import Verdict

CAMERA = MODEL._replace(zero_flux=1.0)
VOTES, POLES = AS_READ._replace(votes=PRINTED), AS_READ._replace(poles=PRINTED)
BOTH = AS_READ._replace(votes=PRINTED, poles=PRINTED)


def most_often(stars):
    """Those that occur most often in a list."""
    counts = Counter(stars)
    most = max(counts.values(), default=0)
    return [star for star, count in counts.items() if count == most]


class Slow:
    """Section 5 with sets; the union (41) and one pole after the other as they are printed."""

    def __init__(self, pairs, u_c, flux, union):
        self.sky, self.u_c, self.union = Sky(pairs), u_c, union
        self.vmag, self.magnitude = pairs.stars.vmag, -2.5 * np.log10(flux)
        self.n, self.lists = len(flux), {}

    def elements(self, i, j):
        """Unordered pairs of (40)."""
        limit = MULTIPOLE.magnitude_tolerance
        found = set()
        for a, b in self.sky.ways(angle(self.u_c[i], self.u_c[j]), MULTIPOLE.tolerance):
            if (
                abs(self.vmag[a] - self.magnitude[i]) < limit
                and abs(self.vmag[b] - self.magnitude[j]) < limit
            ):
                found.add(frozenset((a, b)))
        return found

    def ordered(self, i, j):
        """Pairs of (star of i, star of j)."""
        limit = MULTIPOLE.magnitude_tolerance
        return {
            (a, b)
            for a, b in self.sky.ways(angle(self.u_c[i], self.u_c[j]), MULTIPOLE.tolerance)
            if abs(self.vmag[a] - self.magnitude[i]) < limit and abs(self.vmag[b] - self.magnitude[j]) < limit
        }

    def accepted(self, i):
        if i not in self.lists:
            self.lists[i] = self._of_union(i) if self.union else self._of_votes(i)
        return self.lists[i]

    def _of_union(self, i):
        sets = {j: self.elements(i, j) for j in range(self.n) if j != i}
        stars = [star for pair in set().union(*sets.values()) for star in pair]
        best = most_often(stars)
        if len(best) != 1:
            return None
        found = {i: best[0]}
        for j, pairs in sets.items():
            others = [next(iter(pair - {best[0]})) for pair in pairs if best[0] in pair]
            if len(others) == 1:
                found[j] = others[0]
        return found

    def _of_votes(self, i):
        sets = {j: self.ordered(i, j) for j in range(self.n) if j != i}
        stars = [a for pairs in sets.values() for a in {a for a, _ in pairs}]
        best = most_often(stars)
        if len(best) != 1:
            return None
        found = {i: best[0]}
        for j, pairs in sets.items():
            others = [b for a, b in pairs if a == best[0]]
            if len(others) == 1:
                found[j] = others[0]
        return found

    def agreed(self, first, second):
        both = {k: name for k, name in first.items() if second.get(k) == name}
        names = list(both.values())
        star = np.array([both[k] if k in both and names.count(both[k]) == 1 else -1 for k in range(self.n)])
        return star if (star >= 0).sum() >= MULTIPOLE.fewest_stars else None

    def all_pairs(self):
        for i in range(self.n):
            first = self.accepted(i)
            for j in range(self.n):
                if first and j != i and j in first and self.accepted(j):
                    star = self.agreed(first, self.accepted(j))
                    if star is not None:
                        return star
        return np.full(self.n, -1)

    def once_each(self):
        tried, before = [], None
        while True:
            choice = [i for i in range(self.n) if i not in tried and (before is None or i in before)]
            if not choice:
                if before is None:
                    return np.full(self.n, -1)
                before = None
                continue
            tried.append(choice[0])
            mine = self.accepted(choice[0])
            if not mine:
                continue
            if before is not None:
                star = self.agreed(before, mine)
                if star is not None:
                    return star
            before = mine


def shefex_field(seed, n_false):
    rng, pairs = np.random.default_rng(seed), ready_tracker().pairs
    return centroid_list(rng, pairs.stars, random_attitude(rng), n_false, noise_px=0.3)


@pytest.mark.parametrize("reading", [VOTES, POLES, BOTH])
def test_each_reading_against_sets(reading):
    pairs, n_solved = ready_tracker().pairs, 0
    for seed, n_false in ((1, 2), (2, 5), (3, 12), (4, 8), (5, 3), (6, 14)):
        u_c, flux, _ = shefex_field(seed, n_false)
        slow = Slow(pairs, u_c, flux, reading.votes == PRINTED)
        expected = slow.once_each() if reading.poles == PRINTED else slow.all_pairs()
        found = as_printed.match(MULTIPOLE, CAMERA, pairs, u_c, flux, reading)
        np.testing.assert_array_equal(found.star, expected)
        assert (found.reason == 0) == (expected >= 0).any()
        n_solved += (expected >= 0).any()
    assert n_solved >= 3


def test_read_by_us_is_the_method_that_flies():
    pairs = ready_tracker().pairs
    for seed in (1, 2, 3):
        u_c, flux, _ = shefex_field(seed, 6)
        found = as_printed.match(MULTIPOLE, CAMERA, pairs, u_c, flux)
        np.testing.assert_array_equal(found.star, multipole.match(MULTIPOLE, CAMERA, pairs, u_c, flux).star)
        slow = Slow(pairs, u_c, flux, False)
        np.testing.assert_array_equal(found.star, slow.all_pairs())
    few = as_printed.match(MULTIPOLE, CAMERA, pairs, u_c[:4], flux[:4], BOTH)
    assert few.reason != 0 and (few.star == -1).all()


def clusters(n=3):
    """Clusters of two columns and eleven rows, one of them at the border of the frame."""
    first = np.array([20, 50, 0])[:n]
    return SimpleNamespace(
        first_row=first, last_row=first + 10, first_column=np.array([30, 60, 90]),
        last_column=np.array([31, 61, 91]), energy_dn=np.array([900.0, 800.0, 700.0]),
        xy_px=np.column_stack([[30.5, 60.5, 90.5], first + 5.0]), sigma_px=np.full((3, 2), 0.1),
        begin=np.arange(4) * 22, n_saturated=np.zeros(3, dtype=np.int64),
    )  # fmt: skip


def test_light_of_a_whole_cluster_as_printed_and_of_a_row_s_exposure_as_read():
    """A star that runs with the rows shines longer: by its extent times the time of a line."""
    settings = SimpleNamespace(slowest=10.0)
    times = row_times(0.2, 0.2 / 128, 128)
    rows, shift_px = np.array([0, 1, 2]), np.array([[0.0, 10.0]] * 3)
    read = chain.detections(settings, times, clusters(), rows, shift_px)
    printed = chain.detections(settings, times, clusters(), rows, shift_px, AS_PRINTED)
    np.testing.assert_allclose(printed.flux_dn, [900.0, 800.0, 700.0])
    longer = (0.2 + 10 * 0.2 / 128) / 0.2
    np.testing.assert_allclose(printed.flux_dn / read.flux_dn, longer)
    whole = row_times(0.2, 0.0, 128)  # a global shutter: no difference
    for reading in (AS_READ, AS_PRINTED):
        light = chain.detections(settings, whole, clusters(), rows, shift_px, reading).flux_dn
        np.testing.assert_allclose(light, [900.0, 800.0, 700.0])


def test_clusters_that_the_border_cuts_are_kept_as_printed(monkeypatch):
    monkeypatch.setattr(chain, "fuse", lambda before, now, distance: np.column_stack([np.arange(3)] * 2))
    settings, both = SimpleNamespace(fusion_distance=2.0), (clusters(), clusters())
    read, _ = chain.fused(settings, *both, (128, 128))
    printed, _ = chain.fused(settings, *both, (128, 128), AS_READ._replace(border=PRINTED))
    assert list(read) == [0, 1] and list(printed) == [0, 1, 2]


def test_what_differs_is_said_with_the_figures_of_the_run():
    """A reading that reaches the published figure explains; where none does, all of them are named."""
    shape = 400, len(readings.RATES), len(readings.SHUTTERS), len(flight.CASES), len(readings.NAMES)
    outcomes = np.zeros(shape, dtype=np.int64)
    outcomes[:40] = 1  # ten per cent everywhere
    outcomes[:92, 1, 0, 1, 2] = 1  # worst case, global shutter, 2 deg/s: 23.79 % are published
    rows = {row.condition: row for row in readings.conclude([outcomes])}
    one = rows["worst case, global shutter, 2 deg/s, as read by us"]
    assert one.verdict == Verdict.EXPLAINED and one.run == "impa-readings/(41) as printed"
    assert "0.23" in one.why
    other = rows["worst case, global shutter, 1 deg/s, as read by us"]
    assert other.verdict == Verdict.OPEN
    assert "published 79 %, as read by us 10" in other.why and "pole order as printed 10" in other.why
    assert rows["all as printed, all cases"].measured == 0.0
