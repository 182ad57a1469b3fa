"""Every command and every code block of the README and of the site does what it says."""

import re

import page_blocks
import pytest
from page_session import ROOT, BlockError, Session

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
NAMES = [str(path.relative_to(ROOT)) for path in PAGES]
BLOCKS = {name: page_blocks.blocks((ROOT / name).read_text(), name) for name in NAMES}


@pytest.fixture
def registers():
    """What pages register is forgotten again."""
    from shefex_nav.onboard.navigation import sensors

    kept = [(one, dict(one)) for one in (sensors.SENSORS, sensors.ARRIVALS)]
    yield
    for one, before in kept:
        one.clear()
        one.update(before)


FLY = {  # ten to forty seconds each
    *("docs/campaigns.md", "docs/how-to/software.md", "docs/how-to/viewer.md", "docs/how-to/state.md"),
    *("docs/how-to/impact.md", "docs/how-to/rare.md", "docs/how-to/robustness.md", "docs/tutorial.md"),
}


def named(name):
    """Parameter of a page."""
    return pytest.param(name, marks=pytest.mark.slow) if name in FLY else name


@pytest.mark.filterwarnings("ignore:Matplotlib is currently using agg")
@pytest.mark.parametrize("name", [named(name) for name in NAMES if BLOCKS[name]])
def test_blocks_of_the_page_run(name, registers, tmp_path, monkeypatch):
    session = Session(tmp_path, monkeypatch)
    for block in BLOCKS[name]:
        session.run(block, name)


def test_blocks_were_found():
    """Most of them are run: the pages do not hide behind reasons."""
    kinds = ("sh", "python", "yaml", "file")
    every = [block for name in NAMES for block in BLOCKS[name] if block.kind in kinds]
    ran = [block for block in every if not block.reason]
    assert len(ran) > 40
    assert len(ran) > 0.75 * len(every)


def test_files_that_pages_name_exist():
    """In backticks too, where no link is checked: `notebooks/...`, `benchmarks/...` and the like."""
    named = re.compile(r"`((?:notebooks|scenarios|benchmarks|docs|tests|shefex_nav)/[\w./-]+)`")
    checked = set()
    for path in [*PAGES, ROOT / "CHANGELOG.md", *(ROOT / "notebooks").glob("*.*")]:
        for target in named.findall(path.read_text()):
            checked.add(target)
            assert (ROOT / target).exists(), f"{path.relative_to(ROOT)}: {target}"
    assert len(checked) > 30 and any(target.startswith("notebooks/") for target in checked)


def mentioned(name):
    """Words behind `shefex-nav` in the running text, and in blocks that are not run: list of text."""
    text = (ROOT / name).read_text()
    found = re.findall(r"`(?:uv run )?shefex-nav ([a-z]+[^`]*)`", text)
    lines = [line for block in BLOCKS[name] if block.reason for line in block.text.splitlines()]
    return found + [line.split("#")[0].partition("shefex-nav ")[2] for line in lines if "shefex-nav " in line]


def test_commands_that_are_not_run_exist():
    """`shefex-nav X --y`: X and --y are there."""
    import typer

    from shefex_nav.commands.app import app

    group, checked = typer.main.get_command(app), 0
    for name in NAMES:
        for words in mentioned(name):
            first, *rest = words.split()
            command, checked = group.commands.get(first), checked + 1
            assert command is not None, f"{name}: {words}"
            if hasattr(command, "commands"):
                command = command.commands[rest[0]]
            known = {option for one in command.params for option in one.opts} | {"--help", "--trust"}
            assert set(re.findall(r"--[a-z][\w-]*", words)) <= known, f"{name}: {words}"
    assert checked > 15


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("```sh\nuv run shefex-nav check nowhere.yaml\n```", "no such file"),
        ("```sh\nuv run shefex-nav fly it\n```", "exit code 2"),
        ("```sh\ncurl somewhere\n```", "is not known here"),
        ("```python\nassert 1 == 2\n```", "AssertionError"),
        ("```yaml\nlaunch: {elevation: 80}\n```", "has no unit"),
        ("```yaml\nlaunch: {elevaton: 80 deg}\n```", "did you mean 'elevation'"),
    ],
)
def test_a_block_that_is_wrong_is_noticed(text, message, tmp_path, monkeypatch):
    session = Session(tmp_path, monkeypatch)
    with pytest.raises(BlockError, match=message):
        session.run(page_blocks.blocks(text, "page")[0], "page")


@pytest.mark.parametrize(
    "text",
    [
        "<!-- not run: -->\n```sh\nls\n```",
        "<!-- not run: why -->\ntext\n",
        "<!-- short: a => b -->\n```\nc\n```",
        "```rust\nfn\n```",
        "<!-- skip: why -->\n```sh\nls\n```",
    ],
)
def test_a_comment_that_is_wrong_is_noticed(text):
    with pytest.raises(page_blocks.BadPage):
        page_blocks.blocks(text, "page")


def test_comments_of_a_line_are_all_taken():
    text = "<!-- short: a => b --> <!-- short: c => d -->\n<!-- flight: 30 s -->\n```sh\nls a c\n```"
    block = page_blocks.blocks(text, "page")[0]
    assert block.text == "ls b d\n" and block.end_s == 30.0 and not block.reason
