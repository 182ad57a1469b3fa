"""One run of a campaign again: the same scenario, draws and seeds, compared with what was kept of it."""

from typing import NamedTuple

from shefex_nav import files
from shefex_nav.campaign import draws, engine, runs_file, store, table
from shefex_nav.campaign import head as heads
from shefex_nav.campaign import plan as planning
from shefex_nav.files import content_of
from shefex_nav.log import thinning
from shefex_nav.plugins import NotTrusted, PluginError
from shefex_nav.scenario import load, software

MOST_WORDS = 8  # differences that are told


class Repeated(NamedTuple):
    """What came out of a run that was flown again."""

    run: int
    record: dict  # of this time
    series: bytes | None  # an .npz file
    kept: dict | None  # the record that was kept; None without one that can be read
    differences: dict  # column -> (kept, now); empty if they are the same
    notes: list  # texts for people
    log: str | None

    @property
    def same(self):
        """Whether the row is the kept one, timing aside."""
        return self.kept is not None and not self.differences

    def result(self):
        """Plain dict for JSON."""
        return {
            "run": self.run,
            "same": self.same,
            "differences": {name: list(values) for name, values in self.differences.items()},
            **{name: self.record[name] for name in ("status", "reason", "seed", "draws", "summary")},
            "log": self.log,
        }

    def words(self):
        """For people."""
        about = f"run {self.run}: {self.record['status']}"
        about += f", {self.record['reason']}" if self.record["reason"] else ""
        if self.kept is None:
            return f"{about}; nothing was kept of it that could be compared"
        if not self.differences:
            return f"{about}; the same as its row"
        lines = [f"{about}; differs from its row in {len(self.differences)} columns:"]
        for name, (kept, now) in list(self.differences.items())[:MOST_WORDS]:
            lines.append(f"  {name}: {kept!r} was kept, now {now!r}")
        return "\n".join(lines)


def repeat(folder, run, log=None, *, lane=engine.ProcessLane):
    """Fly run number `run` of the campaign in `folder` again, with a log at the path `log` if one is given.

    It is flown in a process of its own, as the campaign's runs were: with one thread for linear algebra.
    -> Repeated; StoreError if there is no such campaign or run, or if its software was edited since,
    EngineError if it does not come to an end
    """
    head = read_head(folder, run)
    plan = plan_of(head, folder)
    pattern = load.Pattern(plan.source, plan.name)
    _check_software(pattern.scenario, folder)
    job = draws.Sampler(plan, pattern.dispersed).job(run)
    part = None if log is None else files.part(log)
    taken = []
    try:
        lost = engine.fly([job._replace(log=part and str(part))], [lane(plan)], taken.append)
        if lost:
            raise engine.EngineError(f"run {run}: {lost[0].reason}")
        written = part is not None and part.exists()  # a run may fail before its first record
        if written:
            files.finish(log)
    finally:
        if part is not None:
            part.unlink(missing_ok=True)
    (flown,) = taken
    kept, notes = _kept(folder, run)
    differences = {} if kept is None else compared(kept, flown.record)
    notes += _changes(head["versions"], plan.versions)
    if written and (rate_hz := pattern.scenario.log.rate) != thinning.LOWEST_HZ:
        notes.append(
            f"the log has truth and solution at {rate_hz:g} Hz, a campaign's figures are of "
            f"{thinning.LOWEST_HZ} Hz: `report {log}` differs a little from the row"
        )
    return Repeated(run, *flown, kept, differences, notes, str(log) if written else None)


def _kept(folder, run):
    """(record that is kept, notes for people); no record if there is none, or a disk has spoilt it."""
    try:
        return store.Store(folder).record(run), []
    except runs_file.SpoiltError as error:
        return None, [str(error)]


def _check_software(scenario, folder):
    """StoreError unless the software of a user's own that was flown is still there as it was."""
    try:
        software.refuse_changed(scenario)
    except NotTrusted:
        raise
    except PluginError as error:
        words = "put back what was flown, or fly a new campaign with --out"
        raise store.StoreError(f"{folder}: {error}; {words}") from None


def read_head(folder, run):
    """What campaign.json holds of the campaign in `folder`, which has a run of that number; StoreError."""
    head = heads.read_head(folder)
    if not 0 <= run < head["runs"]:
        raise store.StoreError(f"{folder}: has runs 0 to {head['runs'] - 1}, there is no run {run}")
    return head


def plan_of(head, folder):
    """Plan of a campaign as it was flown."""
    shared = head["flight"] == "shared"
    return planning.Plan(
        name=head["scenario"],
        source=head["source"],
        seed=head["seed"],
        runs=head["runs"],
        sampling=head["sampling"],
        series_rate=head["rate"],
        shared=shared,
        versions=planning.versions(),
        flight=_flight(head, folder) if shared else None,
    )


def _flight(head, folder):
    """The flight that all runs share, as bytes."""
    path = folder / "flight.npz"
    try:
        content = content_of(path)
    except FileNotFoundError:
        raise store.StoreError(f"{path}: the flight that all runs share is not there") from None
    if planning.digest(content) != head["flight_sha256"]:
        raise store.StoreError(f"{path}: is not what the runs flew; `shefex-nav campaign` makes it again")
    return content


def compared(kept, now):
    """{column: (kept, now)} of two records whose rows differ, timing aside."""
    a, b = table.row(kept), table.row(now)
    names = [name for name in dict.fromkeys([*a, *b]) if not name.startswith("timing.")]
    return {name: (a.get(name), b.get(name)) for name in names if a.get(name) != b.get(name)}


def _changes(then, now):
    """A line for each version that has changed since the campaign."""
    return [
        f"{store.NAMES.get(name, name)} has changed since: {then[name]} then, {now.get(name)} now"
        for name in then
        if then[name] != now.get(name)
    ]
