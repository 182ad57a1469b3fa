"""Spoilt lines of a study: told with file, line and field; the last one, cut off, is flown again."""

import json

import pytest

from shefex_nav.verify.robustness import design, factors, flight, store
from shefex_nav.verify.robustness.lines import LineError

ASKED = {"scenarios": ["rexus_like"], "set": [], "seed": 0, "of": "design", "code": "0123"}
QUANTITY = {
    "usable_s": 213.7, "misleading_s": 0.0, "misleading_times": 0, "misleading_from_s": None,
    "largest_ratio": 0.2,
}  # fmt: skip
FIGURES = {
    "quantities": {"position": QUANTITY, "attitude": QUANTITY}, "alarms": [], "sigma_deg": 0.02,
    "nees_end": 14.4, "nees_usable": None, "end_s": 275.1,
}  # fmt: skip
ALARM = {"beyond_s": 0.0, "late_s": 0.0, "undetected_s": 0.0, "wrong_words": 0, "after_s": None}
FAULT = {
    "start_s": 10.0, "end_s": 20.0, "settings": ["gps.outages=[]"], "usable_again_s": -1.0,
    "detectable": [{"what": "gyro stuck", "start_s": 10.0, "t_s": None, "by": "", "sum": 1.5}],
    "alarm": {"position": ALARM},
}  # fmt: skip


def record(cell, **changed):
    head = {"cell": cell, "flight": 0, "seed": flight.seed_of(0, cell, 0), "rocket": "rexus_like"}
    own = design.cells()[cell]
    head |= {"grade": own.grade, "told": own.told, "happens": own.happens, "phase": own.phase}
    told = factors.TOLD[own.told]
    flown = {"told_kind": told.kind, "noise_told": told.residuals, "risk": 1e-5} | FIGURES
    return head | flown | {"twin": FIGURES, "fault": FAULT, "cpu_s": 5.0} | changed


def failed(cell):
    head = {name: one for name, one in record(cell).items() if name in store.lines.Head.model_fields}
    return head | {"failed": "FlightError: it is lost", "cpu_s": 1.0}


@pytest.fixture
def study(tmp_path):
    """Function of what stands in the file -> the records that go on."""

    def opened(content):
        (tmp_path / store.HEAD).write_text(json.dumps(ASKED))
        (tmp_path / store.FLIGHTS).write_bytes(content)
        with store.Store(tmp_path, ASKED, True) as kept:
            return kept.done, (tmp_path / store.FLIGHTS).read_bytes()

    return opened


def line(one):
    return json.dumps(one).encode() + b"\n"


def test_what_was_written_is_read(study):
    given = [record(0), failed(1), record(2, twin=None, fault=None)]
    done, _ = study(b"".join(map(line, given)))
    assert list(done.values()) == given


@pytest.mark.parametrize("rest", [line(record(1))[:40], line(record(1))[:-1], b"\0" * 50, b"\xff"])
def test_a_last_line_that_is_cut_off_is_flown_again(study, rest):
    done, left = study(line(record(0)) + rest)
    assert list(done.values()) == [record(0)] and left == line(record(0))


def test_two_at_once_do_not_write_into_one_folder(tmp_path):
    """The second would take the line that the first is writing for one that was cut off."""
    with store.Store(tmp_path, ASKED, False) as kept:
        with pytest.raises(store.StoreError, match="another study is at work in this folder"):
            store.Store(tmp_path, ASKED, True)
        kept.keep(record(0))
    with store.Store(tmp_path, ASKED, True) as again:
        assert list(again.done.values()) == [record(0)]


def spoilt(path, value):
    """A record with another value at a dotted path; None takes it away."""
    one = json.loads(json.dumps(record(1)))
    *inner, last = (int(part) if part.isdigit() else part for part in path.split("."))
    place = one
    for part in inner:
        place = place[part]
    if value is None:
        del place[last]
    else:
        place[last] = value
    return line(one)


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (line(record(1))[:40] + b"\n", "is no record of a flight"),
        (b"\n", "is no record of a flight"),
        (b"\xff\xfe\n", "is no record of a flight .*can't decode"),
        (b"[" * 100000 + b"\n", "is no record of a flight"),
        (b"5\n", "the line: got 5, expected an object"),
        (b"[1]\n", r"the line: got \[1\], expected an object"),
        (b"null\n", "the line: got null, expected an object"),
        (spoilt("end_s", float("nan")), "is no record of a flight .NaN is no number"),
        (line(record(1)).replace(b"275.1", b"1e400", 1), "end_s: got Infinity, expected a finite number"),
        (spoilt("end_s", "soon"), 'end_s: got "soon", expected a valid number'),
        (spoilt("end_s", True), "end_s: got true, expected a valid number"),
        (spoilt("end_s", None), "end_s: is missing"),
        (spoilt("speed", 1.0), "speed: is no field of a record"),
        (spoilt("cell", 1.5), "cell: got 1.5, expected a valid integer"),
        (spoilt("cell", [1]), r"cell: got \[1\], expected a valid integer"),
        (spoilt("cell", 1000), "cell: got 1000, expected one of"),
        (spoilt("grade", "golden"), 'grade: got "golden", expected ".*" of this cell'),
        (spoilt("noise_told", 7.0), "noise_told: got 7.0, expected .* of this cell"),
        (spoilt("seed", 5), "seed: got 5, expected [0-9]+ of this cell and flight"),
        (spoilt("risk", 2.0), "risk: got 2.0, expected less than or equal to 1"),
        (spoilt("quantities", []), r"quantities: got \[\], expected an object"),
        (spoilt("quantities.attitude.usable_s", -1.0), "quantities.attitude.usable_s: got -1.0, expected"),
        (spoilt("twin.nees_end", "x"), 'twin.nees_end: got "x", expected a valid number'),
        (spoilt("fault.detectable.0.t_s", "x"), 'fault.detectable.0.t_s: got "x", expected a valid number'),
        (spoilt("fault.settings.0", 7), "fault.settings.0: got 7, expected a valid string"),
        (line(record(0)), "flight 0 of cell 0 stands in line 1 already"),
    ],
)
def test_a_spoilt_line_is_told_with_its_number(study, tmp_path, second, words):
    before = line(record(0)) + second + line(record(2))
    with pytest.raises(LineError, match=rf"flights\.jsonl:2: {words}"):
        study(before)
    assert (tmp_path / store.FLIGHTS).read_bytes() == before
