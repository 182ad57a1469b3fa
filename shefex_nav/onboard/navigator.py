"""The navigation that comes with the program: the error-state filter, or a bank of filters while an angle of
the attitude is not known.

Its memory (`fusion.Filter`: history of the last `history_s`, health of the sensors) changes in place, because
copying it at every tick would cost more than the tick.
"""

from shefex_nav.onboard import star_context
from shefex_nav.onboard.navigation import fusion, search
from shefex_nav.onboard.navigation import ticks as filter_ticks
from shefex_nav.onboard.telemetry import RECORDS


def start(params, alignment, earth, telemetry=RECORDS):
    """Navigator at the instant of the alignment. NavParams, Alignment, EarthRotation -> Navigator"""
    nav, bank = search.start(params, alignment, earth)
    return Navigator(nav, telemetry, bank)


class Navigator:
    """The built-in navigation, a `driving.Software`.

    nav : fusion.Filter; of a bank the best one
    telemetry : who is told of the ticks, `telemetry.Records` or `telemetry.Columns`
    bank : hypotheses.Bank while an angle of the attitude is not known
    """

    def __init__(self, nav, telemetry=RECORDS, bank=None):
        self.nav, self.bank = nav, bank
        self._telemetry, self._ticks = telemetry, 0

    @property
    def now_s(self):
        """End of the tick that has been reached."""
        return self.nav.history.ends_s[-1]

    def advance(self, blocks, first, last):
        """As of `driving.Software`."""
        if self.bank is not None:
            search.advance(self.bank, blocks, first)
            self._ticks += 1
            return 1, []
        blind = self.nav.watch.imu_blind  # until the last tick: it ends there if that changes
        done = filter_ticks.advance(self.nav, blocks, first, last)
        begin, self._ticks = self._ticks, self._ticks + done
        passed = self._telemetry.passed(self.nav, begin, self._ticks, blind)
        return done, [(first + tick - begin - 1, records) for tick, records in passed]

    def update(self, arrived):
        """As of `driving.Software`, of GpsFix, GpsRanges, readings of instruments and StarFix.

        -> list of GateResult and NavHealth, then what the telemetry hands over
        """
        if self.bank is not None:
            return self._search(arrived)
        outputs = fusion.take(self.nav, arrived) if arrived else []
        outputs += self.nav.watch.changes()
        return outputs + self._telemetry.now(self.nav, self._ticks)

    def _search(self, arrived):
        """`update` while an angle of the attitude is not known."""
        bank, outputs, found = self.bank, [], None
        if arrived:
            outputs = search.fuse(bank, arrived)
            found = search.settled(bank, self.nav.params, self.nav.earth)
        if found is None:
            self.nav = bank.best
            return outputs + self._telemetry.now(search.mixed_filter(bank), self._ticks)
        self.nav, self.bank = found, None
        return outputs + self._telemetry.now(found, self._ticks)

    def close(self):
        """There are no more ticks."""

    def context(self, frame, sky, predicts=True):
        """What the navigation knows about a frame: `tracker.Context`.

        sky : star_context.Sky; predicts : False for a chain that does not search by the predicted attitude
        """
        return (star_context.full_context if predicts else star_context.brief_context)(self.nav, frame, sky)
