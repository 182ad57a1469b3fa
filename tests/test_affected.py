"""What `pytest --affected` chooses: whatever a change can reach, and not much more."""

import subprocess
import sys

import affected
import pytest

SOURCES = {  # of a small project
    "shefex_nav/__init__.py": '_PUBLIC = {"fly": "mission"}',
    "shefex_nav/__main__.py": "from shefex_nav.commands import main",
    "shefex_nav/commands/__init__.py": "",
    "shefex_nav/commands/main.py": (
        "from shefex_nav.commands.run import run\nfrom shefex_nav.commands.show import show\n"
    ),
    "shefex_nav/commands/painting.py": "def paint():\n    from shefex_nav import picture\n",
    "shefex_nav/commands/run.py": (
        "def run():\n    start()\ndef start():\n    from shefex_nav import mission\n"
    ),
    "shefex_nav/commands/show.py": (
        "from shefex_nav.commands.painting import paint\ndef show():\n    paint()\n"
    ),
    "shefex_nav/kernel.py": "def turn(x):\n    return x + 1\n",
    "shefex_nav/mission.py": "def fly():\n    from shefex_nav.kernel import turn\n",
    "shefex_nav/picture.py": "NAME = 'data/sky.png'",
    "tests/conftest.py": "def command():\n    from shefex_nav.commands import main\n",
    "tests/helper.py": "import shefex_nav.kernel",
    "tests/test_all.py": "FILES = list(PACKAGE.rglob('*.py'))",
    "tests/test_attribute.py": "import shefex_nav\ndef test_it():\n    shefex_nav.fly()\n",
    "tests/test_code.py": "CODE = 'from shefex_nav import mission\\nmission.fly()'",
    "tests/test_command.py": "def test_it(command):\n    command('run')\n",
    "tests/test_alone.py": "import sys\nRUN = [sys.executable, '-m', 'shefex_nav', 'show']",
    "tests/test_helper.py": "import helper",
    "tests/test_nothing.py": "import math",
    "tests/test_template.py": "CODE = f'import shefex_nav.kernel as k; {CALL}'",
    "tests/test_text.py": "PATCHED = 'shefex_nav.picture.NAME'",
}
KERNEL = {"all", "attribute", "code", "command", "helper", "template"}  # what reaches kernel.py
EVERY = {name[len("tests/test_") : -len(".py")] for name in SOURCES if name.startswith("tests/test_")}


@pytest.fixture
def project(tmp_path):
    """Folder of the small project, in git."""
    for name, text in SOURCES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    git = "git", "-c", "user.name=a", "-c", "user.email=a@b"
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "first"]):
        subprocess.run([*git, *words], cwd=tmp_path, check=True)
    return tmp_path


def chosen(project, *changed):
    return {name[len("tests/test_") : -len(".py")] for name in affected.select(project, set(changed), {})[0]}


@pytest.mark.parametrize(
    ("changed", "tests"),
    [
        ("shefex_nav/kernel.py", KERNEL),
        ("shefex_nav/mission.py", {"all", "attribute", "code", "command"}),
        ("shefex_nav/picture.py", {"all", "alone", "text"}),
        ("shefex_nav/commands/main.py", {"all", "alone", "command"}),
        ("shefex_nav/commands/run.py", {"all", "alone", "command"}),
        ("shefex_nav/data/sky.png", {"alone", "text"}),
        ("shefex_nav/__init__.py", EVERY - {"nothing"}),
        ("tests/helper.py", {"helper"}),
        ("tests/test_nothing.py", {"nothing"}),
        ("tests/conftest.py", EVERY),
        ("uv.lock", EVERY),
        ("pyproject.toml", EVERY),
        ("LICENSE", set()),
    ],
)
def test_a_change_chooses_what_it_can_reach(project, changed, tests):
    assert chosen(project, changed) == tests


def test_a_file_that_is_gone_is_still_missed_by_its_users(project):
    (project / "shefex_nav" / "kernel.py").unlink()
    assert chosen(project, "shefex_nav/kernel.py") == KERNEL


def test_what_was_read_before_is_not_read_again(project, monkeypatch):
    first, kept = affected.select(project, {"shefex_nav/kernel.py"}, {})
    monkeypatch.setattr(affected, "read", None)
    assert affected.select(project, {"shefex_nav/kernel.py"}, kept) == (first, kept)
    monkeypatch.setattr(affected, "READER", b"another reader")
    with pytest.raises(TypeError):  # it reads anew
        affected.select(project, {"shefex_nav/kernel.py"}, kept)


def test_changes_are_those_since_a_commit_and_files_that_git_does_not_know(project):
    assert affected.changes(project, "HEAD") == set()
    (project / "shefex_nav" / "kernel.py").write_text("def turn(x):\n    return x - 1\n")
    (project / "tests" / "test_new.py").write_text("")
    assert affected.changes(project, "HEAD") == {"shefex_nav/kernel.py", "tests/test_new.py"}
    with pytest.raises(pytest.UsageError, match="--affected nowhere: "):
        affected.changes(project, "nowhere")


def test_a_file_that_has_another_name_is_gone_under_its_old_one(project):
    subprocess.run(["git", "mv", "shefex_nav/kernel.py", "shefex_nav/turn.py"], cwd=project, check=True)
    assert affected.changes(project, "HEAD") == {"shefex_nav/kernel.py", "shefex_nav/turn.py"}


@pytest.mark.slow
def test_a_line_of_a_compiled_kernel_chooses_its_tests_and_not_others():
    """In this project: the update of the filter and a lens; missions that a command flies among them."""
    update, known = affected.select(affected.ROOT, {"shefex_nav/onboard/navigation/strapdown.py"}, {})
    assert {"tests/onboard/test_nav_strapdown.py", "tests/test_mission.py", "tests/test_cli.py"} < set(update)
    assert "tests/geometry/test_euler.py" not in update and "tests/solve/test_lens.py" not in update
    lens, _ = affected.select(affected.ROOT, {"shefex_nav/solve/lens.py"}, known)
    assert (
        "tests/solve/test_lens.py" in lens and len(lens) < 48
    )  # of 350; camera files have a lens, and what exports them


@pytest.mark.skipif(not (affected.ROOT / ".git").exists(), reason="no repository")
@pytest.mark.slow
def test_workers_are_told_what_was_chosen(tmp_path):
    """Of one file that is asked for, where none of its tests is wanted: nothing is run, and nothing fails."""
    words = "--affected=HEAD", "-n1", "-k", "no_such_test", "-o", f"cache_dir={tmp_path}"
    command = [sys.executable, "-m", "pytest", *words, "tests/geometry/test_euler.py"]
    done = subprocess.run(command, cwd=affected.ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == pytest.ExitCode.NO_TESTS_COLLECTED, done.stdout
    assert "rror" not in done.stdout
