"""How far a campaign is: a bar in a terminal, a line now and then where there is none."""

import time
from contextlib import contextmanager

QUIET_S = 5.0  # at least, between two lines
LONGEST_S = 60.0  # without one


class Tally:
    """What is known of the runs so far."""

    def __init__(self, total, badness=lambda record: None, clock=time.monotonic):
        self.total, self.done, self.failed, self.flown = total, 0, 0, 0
        self.worst = None  # (badness, run)
        self.scores = {}  # run -> badness, None of one that failed
        self._badness, self._clock, self._began = badness, clock, clock()

    def begin(self):
        """The runs that are flown now begin."""
        self._began = self._clock()

    def take(self, record, *, flown=True):
        """Count a run, flown now or found in the folder."""
        self.done += 1
        self.flown += flown
        self.failed += record["status"] == "failed"
        bad = self.scores[record["run"]] = self._badness(record)
        if bad is not None and (self.worst is None or bad > self.worst[0]):
            self.worst = (bad, record["run"])

    def left_s(self):
        """Seconds that the rest is going to take, None before the first run."""
        if not self.flown:
            return None
        return (self._clock() - self._began) / self.flown * (self.total - self.done)

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


class Show:
    """Tells people what happens."""

    def __init__(self, say, clock=time.monotonic):
        """say: called with each line."""
        self.say, self._clock = say, clock

    @contextmanager
    def bar(self, tally):
        """Gives a function to be called after each run; it says a line for each tenth, or each minute."""
        tally.begin()
        shown, said_s = 10 * tally.done // tally.total, self._clock()

        def note():
            nonlocal shown, said_s
            now, tenth = self._clock(), 10 * tally.done // tally.total
            if tally.done < tally.total and now - said_s >= (QUIET_S if tenth > shown else LONGEST_S):
                self.say(f"{tally.done} of {tally.total} runs, {tally.words()}")
                shown, said_s = tenth, now

        yield note


class TerminalShow(Show):
    """The same with a bar, for a terminal."""

    @contextmanager
    def bar(self, tally):
        """Gives a function to be called after each run."""
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        tally.begin()
        columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[words]}"))
        with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task("fly", total=tally.total, completed=tally.done, words=tally.words())
            yield lambda: progress.update(task, completed=tally.done, words=tally.words())


def show(say):
    """The Show that stderr is good for."""
    from rich.console import Console

    return TerminalShow(say) if Console(stderr=True).is_terminal else Show(say)
