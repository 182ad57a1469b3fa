"""Files of the project that pages link to are part of the site: scenarios; and the list of decisions."""

import re
from pathlib import Path

from mkdocs.structure.files import File

_LINK = re.compile(r"\]\(((?:\.\./)+)(scenarios/[^)#]+)\)")
DECISIONS = "decisions/"


def on_config(config, **_):
    """Put every decision into the navigation, with its title."""
    for entry in config.nav:
        if isinstance(entry, dict) and entry.get("Decisions") == DECISIONS:
            entry["Decisions"] = sorted(
                f"{DECISIONS}{path.name}" for path in Path(config.docs_dir, DECISIONS).glob("*.md")
            )
    return config


def on_files(files, config, **_):
    """Add the scenarios with their data."""
    root = Path(config.docs_dir).parent
    for path in sorted((root / "scenarios").rglob("*")):
        if path.is_file():
            name = path.relative_to(root).as_posix()
            files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown, page, **_):
    """Links out of docs/ to the scenarios lead to their copies in the site."""
    out = "../" * (page.file.src_uri.count("/") + 1)

    def inside(link):
        return f"]({link[1].removeprefix('../')}{link[2]})" if link[1] == out else link[0]

    return _LINK.sub(inside, markdown)
