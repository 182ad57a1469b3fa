"""Files that are no scenario, or cannot be read: one clear message with file, line and column."""

import os
import threading
from contextlib import contextmanager, suppress

import pytest
from broken import TEXT, the_message

from shefex_nav import plugins
from shefex_nav.log.reader import read as read_log
from shefex_nav.log.topics import LogError
from shefex_nav.plugins import PluginError
from shefex_nav.scenario import files as files_module
from shefex_nav.scenario.load import ScenarioError, load, load_text
from shefex_nav.solve.picture import PictureError
from shefex_nav.solve.picture import read as read_picture

ALIASES = "a0: &a0 [1,1,1,1,1,1,1,1,1]\n" + "".join(
    f"a{k}: &a{k} [{','.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 9)
)  # 9^9 values in 300 bytes
# kind: (whole file, place, words)
NOT_A_SCENARIO = {
    "empty file": ("", "1:1", "the file is empty"),
    "only comments": ("# nothing\n", "1:1", "the file is empty"),
    "list at the top": ("- mission\n- earth\n", "1:1", "the file holds a list; expected a mapping"),
    "text": ("hello\n", "1:1", "the file holds a single value"),
    "open bracket": ("mission: [1, 2\nearth: 3\n", "2:6", "not valid YAML"),
    "key without a colon": ("mission:\n  name: x\nearth\n  model: y\n", "3:1", "'earth' has no colon"),
    "value without a colon": ("mission:\n  name: x\n  rail 8 m\na: b\n", "3:3", "'rail 8 m' has no colon"),
    "two colons": ("mission: a: b\n", "1:11", "mapping values are not allowed here"),
    "tab": ("mission:\n\tname: x\n", "2:1", "indent with spaces, not tabs"),
    "two documents": ("mission: 1\n---\nearth: 2\n", "2:1", "another document"),
    "control character": ("mission: \x02\n", "1:10", "special characters are not allowed"),
    "list as a key": ("mission:\n  [1]: 2\n", "2:3", "mission: a key must be a word"),
    "a key that looks like a form": ("mission:\n  <file>: 2\n", "2:3", "a key must be a word, got '<file>'"),
    "a key that looks like a step": ("mission:\n  '[key]': 2\n", "2:3", "a key must be a word, got '[key]'"),
    "merge key": (
        "mission: &m {a: 1}\nearth:\n  <<: *m\n",
        "3:3",
        "earth: the merge key << of YAML 1.1 is not",
    ),
    "alias to nothing": ("mission: *m\n", "1:10", "undefined alias 'm'"),
    "alias to itself": ("mission: &m\n  name: *m\n", "1:10", "must not contain itself"),
    "foreign tag": ("mission: !!binary abcd\n", "1:10", "is not used in scenarios"),
    "foreign tag of a list": ("mission: !foo [1, 2]\n", "1:10", "mission: tag !foo is not used in scenarios"),
    "foreign tag of a section": ("mission: !!python/x {a: 1}\n", "1:10", "is not used in scenarios"),
    "no number": ("mission: !!float x\n", "1:10", "mission: tag !!float does not fit 'x'"),
    "no whole number": ("mission: !!int 1.5\n", "1:10", "mission: tag !!int does not fit '1.5'"),
    "neither true nor false": ("mission: !!bool yes\n", "1:10", "mission: tag !!bool does not fit 'yes'"),
    "not nothing": ("mission: !!null x\n", "1:10", "mission: tag !!null does not fit 'x'"),
    "no list": ("mission: !!seq {b: 1}\n", "1:10", "mission: tag !!seq does not fit a mapping"),
    "no mapping": ("mission: !!map [b, c]\n", "1:10", "mission: tag !!map does not fit a list"),
    "no text": ("mission: !!str [b, c]\n", "1:10", "mission: tag !!str does not fit a list"),
    "list said to be a mapping": ("!!map [b, c]\n", "1:1", "the file holds a list; expected a mapping"),
    "mapping said to be a list": ("!!seq {b: 1}\n", "1:1", "tag !!seq does not fit a mapping"),
    "YAML of the future": ("%YAML 2.0\n---\nmission: 1\n", "1:1", "leave the line with %YAML out"),
    "extends something else": ("extends: /etc/passwd\n", "1:10", "no scenario file; expected .yaml or .yml"),
    "aliases without end": (ALIASES, "5:5", "aliases repeat more than 50000 values"),
    "extends nothing": ("extends:\n", "1:1", "expected the name of a scenario file"),
    "extends a missing file": ("extends: nowhere.yaml\n", "1:10", "nowhere.yaml' there is no such file"),
    "extends itself": ("extends: broken.yaml\n", "1:10", "extends itself in a circle"),
}


@pytest.mark.parametrize("kind", NOT_A_SCENARIO)
def test_a_file_that_is_no_scenario(tmp_path, kind):
    text, place, words = NOT_A_SCENARIO[kind]
    path = tmp_path / "broken.yaml"
    path.write_text(text, encoding="utf-8")
    said = the_message(path)
    assert said.startswith(f"{path}:{place}: ")
    assert words in said


def test_brackets_without_end(tmp_path):
    path = tmp_path / "deep.yaml"
    path.write_text("mission: " + "[" * 500, encoding="utf-8")
    assert "lists and mappings within each other" in the_message(path)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16"])
def test_not_utf8(tmp_path, encoding):
    path = tmp_path / "broken.yaml"
    path.write_bytes("mission: Andøya\n".encode(encoding))
    assert the_message(path).startswith(f"{path}: is not UTF-8 text")


def test_a_byte_order_mark_is_no_error(tmp_path):
    path = tmp_path / "windows.yaml"
    path.write_text(TEXT, encoding="utf-8-sig")
    assert load(path).mission.name == "shefex2_andoya"


def test_missing_file_and_directory(tmp_path):
    assert the_message(tmp_path / "no.yaml") == f"{tmp_path / 'no.yaml'}: there is no such file"
    assert the_message(tmp_path) == f"{tmp_path}: is a directory, expected a scenario file"
    assert "cannot be read" in the_message("a\0b.yaml")


def test_a_file_without_permission(tmp_path, monkeypatch):
    """Simulated, because the superuser may read everything."""

    def locked(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(files_module, "open", locked, raising=False)
    (tmp_path / "x.yaml").touch()
    assert the_message(tmp_path / "x.yaml") == f"{tmp_path / 'x.yaml'}: cannot be read: Permission denied"


def test_a_large_file_is_not_read(tmp_path):
    path = tmp_path / "large.yaml"
    path.write_text("# nothing\n" * 300_000)
    assert the_message(path) == f"{path}: has 3 MB; a scenario file has 2.1 MB at most"


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no such devices")
def test_what_has_no_end_is_not_read():
    assert the_message("/dev/zero") == "/dev/zero: is a device, expected a file"


@pytest.mark.skipif(not os.path.exists("/dev/fd"), reason="pipes have no names here")
def test_a_pipe_is_read_to_its_end():
    """As of `check <(make_scenario)`; one that nobody writes to is empty."""
    with poured(TEXT) as path:
        assert load(path).mission.name == "shefex2_andoya"
    with poured("# nothing\n" * 300_000) as path:
        assert the_message(path) == f"{path}: is larger than 2.1 MB, more than a scenario file has"
    with poured("") as path:
        assert the_message(path) == f"{path}: is a pipe into which nobody writes anything; {EXPECTED}"


EXPECTED = "expected a scenario file"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes have no names here")
def test_a_pipe_without_a_writer_is_not_waited_for(tmp_path):
    """By any reader of files of a user: it would wait for ever, or call it empty."""
    pipe = tmp_path / "x.mcap"
    os.mkfifo(pipe)
    assert the_message(pipe) == f"{pipe}: is a pipe into which nobody writes anything; {EXPECTED}"
    with pytest.raises(LogError, match="cannot be read: is a pipe, expected a file"):
        read_log(pipe)
    with pytest.raises(PictureError, match="is a pipe; expected a picture"):
        read_picture(pipe)
    with pytest.raises(PluginError, match="cannot be read: is a pipe, expected a file"):
        plugins.load(str(pipe.rename(tmp_path / "own.py")), trust=True)


@contextmanager
def poured(text):
    """Path of a pipe into which a text is written."""
    end, begin = os.pipe()

    def write():
        with suppress(BrokenPipeError), os.fdopen(begin, "w") as pipe:
            pipe.write(text)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        yield f"/dev/fd/{end}"
    finally:
        os.close(end)
        writer.join()


@pytest.mark.slow
def test_a_table_of_many_values_goes_through_text_and_back(tmp_path):
    """A scenario's text holds its tables; a limit on their values would make its log unreadable."""
    rows = "".join(f"{0.2 * k:g},{5 + k % 7},{k % 360}\n" for k in range(12_000))
    (tmp_path / "wind.csv").write_text("height_m,speed_m_s,from_deg\n" + rows)
    path = tmp_path / "windy.yaml"
    path.write_text("extends: rexus_like\nwind: {file: wind.csv}\n")
    scenario = load(path)
    assert load_text(scenario.source, "its log").wind == scenario.wind


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("mission.epoch=9999-12-31T23:59:59Z", "is after 2100, to which logs and ephemerides reach"),
        (f"mission.name={'a' * 300}", "has 300 characters, expected 100 at most"),
    ],
)
def test_what_no_log_can_hold(override, words):
    with pytest.raises(ScenarioError, match=words):
        load("night_sky", [override])


def chain(folder, texts):
    """The first of files each of which extends the next."""
    for k, text in enumerate(texts):
        extends = f"extends: c{k + 1}.yaml\n" if k + 1 < len(texts) else ""
        (folder / f"c{k}.yaml").write_text(extends + text)
    return folder / "c0.yaml"


REPEATED = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\nb: &b [*a, *a, *a, *a, *a, *a, *a, *a, *a]\n" + (
    f"c: &c [{', '.join(['*b'] * 20)}]\nd: [{', '.join(['*c'] * 12)}]\n"
)
CHAINS = {  # which file says it, what is said; each file alone is within the limits
    "too deep": (["x: 1\n"] * 51, 49, "c50.yaml': a chain of `extends` has 50 files at most"),
    "too large": (
        ["# " + "x" * 800_000 + "\nx: 1\n"] * 3,
        1,
        "the files of the scenario have more than 2.1 MB in all",
    ),
    "aliases": ([REPEATED] * 3, 1, "aliases repeat more than 50000 values in all files"),
}


@pytest.mark.parametrize("kind", CHAINS)
def test_a_chain_of_files_is_limited_as_a_whole(kind, tmp_path):
    texts, last, words = CHAINS[kind]
    first = chain(tmp_path, texts)
    with pytest.raises(ScenarioError) as refused:
        load(first)
    (message,) = refused.value.messages
    assert message.startswith(f"{tmp_path / f'c{last}.yaml'}:1:10: extends: ") and words in message
    with pytest.raises(ScenarioError, match=r"unknown key|are missing"):
        load(chain(tmp_path, texts[:-1] if kind == "too deep" else texts[:1]))


def test_a_tilde_is_said_to_be_no_home_folder(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("extends: ~/x.yaml\n")
    with pytest.raises(ScenarioError, match="~ is not read as the home folder here, write it out"):
        load(path)
