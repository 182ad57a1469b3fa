"""The page of `solve` names every key that its JSON can have, and no other."""

import ast
import inspect
import re
from pathlib import Path

from shefex_nav.solve import table

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "picture.md"


def test_the_page_has_the_keys_of_the_json():
    rows = PAGE.read_text(encoding="utf-8").split("## What `--json` has")[1].split("\n\n`camera` and")[0]
    named = {
        key
        for row in rows.splitlines()
        if row.startswith("| `")
        for key in re.findall(r"`(\w+)`", row.split("|")[1])
    }
    tree = ast.parse(inspect.getsource(table.as_numbers))
    words = {str(one.value) for one in ast.walk(tree) if isinstance(one, ast.Constant)}
    given = {word for word in words if re.fullmatch(r"[a-z_0-9]+", word)} - {"about_x", "about_y"}
    given -= {"about_boresight", "name", "designation"}  # within others
    assert named == given | {"file"}
