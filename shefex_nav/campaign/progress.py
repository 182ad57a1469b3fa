"""How far a campaign is: a bar in a terminal, a line now and then where there is none."""

import time
from contextlib import contextmanager

from shefex_nav.progress import bar, lines


class Tally:
    """What is known of the runs so far."""

    def __init__(self, total, clock=time.monotonic):
        self.total, self.done, self.failed, self.flown, self.missed = total, 0, 0, 0, 0
        self.worst = None  # (badness, run)
        self._clock, self._began = clock, clock()

    def found(self, standing):
        """Count the runs that were done before: runs_file.Standing."""
        self.done, self.failed, self.missed, self.worst = standing

    def begin(self):
        """The runs that are flown now begin."""
        self._began = self._clock()

    def take(self, record, bad=None):
        """Count a run that was flown now. bad : its badness (`running.badness`), None of one that failed"""
        self.done += 1
        self.flown += 1
        self.failed += record["status"] == "failed"
        self.missed += bad is not None and bad[0] >= 1.0  # requirements not met
        if bad is not None and (self.worst is None or bad > self.worst[0]):
            self.worst = (bad, record["run"])

    def left_s(self):
        """Seconds that the rest is going to take, None before the first run."""
        if not self.flown:
            return None
        return (self._clock() - self._began) / self.flown * (self.total - self.done)

    def words(self):
        """Share that flew to its end, runs that miss a requirement, worst run and time left, as text."""
        rate = 100.0 * (self.done - self.failed) / self.done if self.done else 100.0
        parts = [f"{rate:.1f} % flew to their end"]
        if self.missed:
            parts.append(f"{self.missed} {'misses' if self.missed == 1 else 'miss'} a requirement")
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
    """Tells people what happens: a line for each tenth of the runs, or each minute."""

    def __init__(self, say, clock=time.monotonic):
        """say: called with each line."""
        self.say, self._clock = say, clock

    @contextmanager
    def bar(self, tally):
        """Gives a function to be called after each run."""
        tally.begin()
        told = lines(tally.total, self.say, tally.done, self._clock)
        yield lambda: told(tally.done, f"{tally.done} of {tally.total} runs, {tally.words()}")


class TerminalShow(Show):
    """The same with a bar where stderr is a terminal."""

    @contextmanager
    def bar(self, tally):
        """Gives a function to be called after each run."""
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

        columns = BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[words]}")
        with super().bar(tally) as told, bar(*columns) as progress:
            task = progress.add_task("fly", total=tally.total, completed=tally.done, words=tally.words())

            def note():
                progress.update(task, completed=tally.done, words=tally.words())
                if progress.disable:
                    told()

            yield note
