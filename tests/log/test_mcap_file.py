"""Which files are logs: by their first bytes, or by name."""

from pathlib import Path

import pytest

import shefex_nav
from shefex_nav.log.mcap_file import MAGIC, is_log

PACKAGE = Path(shefex_nav.__file__).parent
OTHER_KINDS = PACKAGE / "scenario" / "kind.py"  # a table of the first bytes of many kinds of file


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("run", MAGIC + b"more", True),
        ("run", MAGIC[:-1], False),
        ("run.csv", b"t_s,r_i_m_x\n", False),
        ("run.mcap", b"", True),
        ("not_there.mcap", None, True),
        ("not_there", None, False),
    ],
)
def test_a_log_is_known_by_its_first_bytes_or_its_name(name, content, expected, tmp_path):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert is_log(tmp_path / name) is expected


def test_the_first_bytes_are_written_down_once():
    found = [path for path in PACKAGE.rglob("*.py") if r'b"\x89MCAP' in path.read_text(encoding="utf-8")]
    assert sorted(found) == [PACKAGE / "log" / "mcap_file.py", OTHER_KINDS]
