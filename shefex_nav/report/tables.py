"""The tables of a log in Python: the same columns that `export` writes, in Arrow.

run.tables["nav"]["r_i_m_x"]     # (N,) array
run.tables.nav                   # the same as run.tables["nav"]
run.tables["nav"].arrow          # pyarrow.Table
run.tables["nav"].to_pandas()    # where pandas is installed
"""

from collections.abc import Mapping
from functools import cached_property
from importlib.util import find_spec

from shefex_nav.report import export


class Table:
    """One table: columns of one length, the first is `t_s`.

    Attributes
    ----------
    name : str
    comments : {name of a column: what it is, with frame and unit}
    """

    def __init__(self, name, columns):
        self.name = name
        self.comments = {one.name: one.comment for one in columns}
        self._values = {one.name: one.values for one in columns}
        self._columns = columns

    def __repr__(self):
        return f"<Table {self.name}, {len(self)} rows: {', '.join(self.comments)}>"

    def __len__(self):
        return len(self._columns[0].values)

    def __getitem__(self, column):
        """(N,) array of a column; KeyError with those that there are."""
        try:
            return self._values[column]
        except KeyError:
            raise KeyError(
                f"{self.name} has no column {column!r}; it has: {', '.join(self._values)}"
            ) from None

    @cached_property
    def arrow(self):
        """The pyarrow.Table, the comments in the metadata of its fields."""
        return export.arrow(self._columns)

    def to_pandas(self):
        """The pandas.DataFrame; ModuleNotFoundError says what to do where pandas is not installed."""
        if find_spec("pandas") is None:
            raise ModuleNotFoundError(
                "to_pandas needs pandas, which is not installed: `pip install pandas` or "
                "`uv pip install pandas`; without it, "
                ".arrow is a pyarrow.Table and [column] a NumPy array"
            )
        return self.arrow.to_pandas()


class Tables(Mapping):
    """The tables of a RunData by their names; those without a row are left out."""

    def __init__(self, data):
        self._tables = {name: Table(name, columns) for name, columns in export.tables(data).items()}

    def __repr__(self):
        return f"<Tables {', '.join(self)}>"

    def __getitem__(self, name):
        """Table of a name; KeyError with those that there are."""
        try:
            return self._tables[name]
        except KeyError:
            raise KeyError(f"there is no table {name!r}; the run has: {', '.join(self)}") from None

    def __getattr__(self, name):
        """The same as an attribute; AttributeError with those that there are."""
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(error.args[0]) from None

    def __dir__(self):
        return [*super().__dir__(), *self]

    def __iter__(self):
        return iter(self._tables)

    def __len__(self):
        return len(self._tables)
