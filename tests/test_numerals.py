"""What counts as a number in a data file: everywhere the same."""

import numpy as np
import pytest

from shefex_nav import numerals
from shefex_nav.environment import yuma
from shefex_nav.report import other_solution
from shefex_nav.scenario import data_table, tables
from shefex_nav.solve import header
from shefex_nav.verify import data as nesc
from shefex_nav.verify import daveml

NONE = "1_0", "nan", "NaN", "inf", "-infinity", "0x10", "１２", "٣", "1e400", "1d5", "--1", "1e", "."
GOOD = {"12": 12.0, "-0.5": -0.5, ".5": 0.5, "5.": 5.0, "+1E-3": 1e-3, " 7\t": 7.0, "1e-400": 0.0}


def test_what_python_writes_is_read_to_the_last_bit():
    values = np.random.default_rng(1).integers(0, 2**64, 3000, dtype=np.uint64).view(float)
    values = values[np.isfinite(values)].tolist()
    assert [numerals.number(repr(value)) for value in values] == values


def test_numbers():
    assert {text: numerals.number(text) for text in GOOD} == GOOD


@pytest.mark.parametrize("text", [*NONE, "", "1,5", "1 2"])
def test_what_is_none(text):
    assert not numerals.is_number(text)
    with pytest.raises(ValueError, match=r"expected a number (such as 12.5|below 1e308), got"):
        numerals.number(text)


@pytest.mark.parametrize("text", NONE)
def test_no_reader_takes_it(tmp_path, text):
    path = tmp_path / "a.csv"

    def written(content):
        path.write_text(content, encoding="utf-8")
        return path

    with pytest.raises(data_table.DataError, match=r"a\.csv:2: b: "):
        data_table.read_csv(written(f"a,b\n1,{text}\n"), ("a", "b"))
    with pytest.raises(data_table.DataError, match=r"a\.csv:1: b: "):
        data_table.read_columns(written(f"1 {text}\n"), ("a", "b"))
    with pytest.raises(tables.BadTable, match="b: expected a number"):
        tables.read(f"a,b\n1,{text}\n", "a.csv", ("a", "b"))
    with pytest.raises(nesc.NescDataError, match=r"a\.csv:3: mach: expected a number"):
        nesc.read_series(written(f"time,mach\n0,1\n1,{text}\n"))
    with pytest.raises(other_solution.BadTable, match=r"a\.csv:2: q_ib_z: expected a number"):
        other_solution.read_csv(written(f"{','.join(other_solution.COLUMNS)}\n{'1,' * 10}{text}\n"))
    with pytest.raises(yuma.BadYuma, match="Eccentricity: expected a number"):
        yuma.items(f"**** 1\nEccentricity: {text}\n")
    with pytest.raises(daveml.DaveMlError, match="x: initialValue: expected a number"):
        daveml.read(written(f'<DAVEfunc><variableDef varID="x" initialValue="{text}"/></DAVEfunc>'))
    with pytest.raises(ValueError, match="EXPTIME: expected a number"):
        header.of_header({"EXPTIME": text})
