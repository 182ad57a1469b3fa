"""How far a campaign is: a bar in a terminal, a line now and then where there is none."""

import time

QUIET_S = 5.0  # at least, between two lines
LONGEST_S = 60.0  # without one


class Tally:
    """What is known of the runs so far."""

    def __init__(self, total, worst_of=None):
        self.total, self.done, self.failed, self.flown = total, 0, 0, 0
        self.worst = None  # (value, run)
        self._worst_of = worst_of or (lambda record: None)
        self._began = time.monotonic()

    def take(self, record, *, flown=True):
        """Count a run, flown now or found in the folder."""
        self.done += 1
        self.flown += flown
        self.failed += record["status"] == "failed"
        value = self._worst_of(record)
        if value is not None and (self.worst is None or value > self.worst[0]):
            self.worst = (value, record["run"])

    def left_s(self):
        """Seconds that the rest is going to take, None before the first run."""
        if not self.flown:
            return None
        return (time.monotonic() - self._began) / self.flown * (self.total - self.done)

    def words(self):
        """Success rate, worst run and time left, as text."""
        rate = 100.0 * (self.done - self.failed) / self.done if self.done else 100.0
        parts = [f"{rate:.1f} % succeeded"]
        if self.worst is not None:
            parts.append(f"worst run {self.worst[1]}")
        left = self.left_s()
        if left is not None and self.done < self.total:
            parts.append(f"{duration(left)} left")
        return ", ".join(parts)


def duration(seconds):
    """Seconds as 1:02:03 or 2:03."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"


def lines(tally, say, clock=time.monotonic):
    """A function to call after each run, which says a line for each tenth of the work, or each minute."""
    shown, said_s = 10 * tally.done // max(tally.total, 1), clock()

    def note():
        nonlocal shown, said_s
        now, tenth = clock(), 10 * tally.done // tally.total
        if tally.done < tally.total and now - said_s >= (QUIET_S if tenth > shown else LONGEST_S):
            say(f"{tally.done} of {tally.total} runs, {tally.words()}")
            shown, said_s = tenth, now

    return note
