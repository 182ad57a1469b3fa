"""What a machine does to a program: one message that names the file, exit code 2, nothing half written."""

import errno
import os
import shutil
import subprocess
import sys

import failing_machine
import pytest

from shefex_nav.files import whole

LIMIT = 20_000  # bytes of a file; Linux refuses more with EFBIG, a full disk with ENOSPC, in the same places
LIMITED = f"""
import resource, sys
sys.dont_write_bytecode = True  # it would be cut off at the limit, and stay in the package
resource.setrlimit(resource.RLIMIT_FSIZE, ({LIMIT}, {LIMIT}))
from shefex_nav.commands.main import main
main()
"""
PLAIN = "from shefex_nav.commands.main import main; main()"
TOO_LARGE, BAD_DISK = os.strerror(errno.EFBIG), os.strerror(errno.EIO)


def shefex_nav(*words, code=PLAIN, cwd=None, without=(), **environment):
    """A command in a process of its own, with an environment of its own."""
    own = {name: value for name, value in os.environ.items() if name not in without} | environment
    done = subprocess.run(
        [sys.executable, "-c", code, *map(os.fsencode, words)],
        capture_output=True, text=True, errors="replace", env=own, cwd=cwd, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr, done.stderr
    return done


@pytest.fixture(scope="module")
def log(once):
    def make(folder):
        done = shefex_nav("run", "night_sky", "--until", "2s", "--out", folder / "night.mcap")
        assert done.returncode == 0, done.stderr

    return once("night of two seconds", make) / "night.mcap"


@pytest.mark.skipif(sys.platform != "linux", reason="no limit of the size of files, or another error")
@pytest.mark.parametrize(
    ("words", "out", "named"),
    [
        (("export", "LOG", "--csv"), "tables", "tables/truth.csv"),
        (("export", "LOG", "--parquet"), "tables", "tables/truth.parquet"),
        (("export", "LOG", "--geojson"), "track.json", "track.json"),
        pytest.param(("report", "LOG", "--html"), "page.html", "page.html", marks=pytest.mark.slow),
        (("report", "LOG", "--figures"), "figures", "figures/glance.png"),
    ],
    ids=lambda words: words[-1] if isinstance(words, tuple) else "",
)
def test_files_that_grow_too_large(words, out, named, log, tmp_path):
    place = tmp_path / out
    done = shefex_nav(*(log if word == "LOG" else word for word in words), place, code=LIMITED)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == f"{tmp_path / named}: cannot be written: {TOO_LARGE}"
    assert not list(tmp_path.rglob("*.part"))
    assert not (tmp_path / named).exists()


@pytest.mark.skipif(sys.platform != "linux", reason="no limit of the size of files, or another error")
def test_a_log_that_grows_too_large(tmp_path):
    done = shefex_nav("run", "night_sky", "--until", "2s", "--out", tmp_path / "night.mcap", code=LIMITED)
    assert done.returncode == 2
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"{tmp_path / 'night.mcap'}: cannot be written: {TOO_LARGE}")


@pytest.fixture(scope="module")
def failing(once):
    """Function that gives the environment of a process whose disk or clock fails."""
    made = once("failing_machine", failing_machine.library) / "failing.so"
    return lambda **settings: failing_machine.environment(made, **settings)


@failing_machine.needed
def test_a_disk_that_does_not_write_a_log(failing, tmp_path):
    place = tmp_path / "night.mcap"
    disk = failing(EIO_WRITE="night.mcap", GOES_WELL=2)
    done = shefex_nav("run", "night_sky", "--until", "2s", "--out", place, **disk)
    assert done.returncode == 2
    words = f"{place}: cannot be written: {BAD_DISK}; what was written before can be read"
    assert done.stderr.splitlines()[-1] == words


@failing_machine.needed
@pytest.mark.parametrize("well", [0, 12])
def test_a_disk_that_does_not_read_a_log(well, log, failing):
    done = shefex_nav("report", log, **failing(EIO_READ="night.mcap", GOES_WELL=well))
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"{log}: cannot be read or written: {BAD_DISK}\n"


def test_a_failure_of_something_else_is_not_said_of_the_file(tmp_path):
    for error, name in ((OSError(errno.ENOSPC, "full"), tmp_path / "a"), (OSError(errno.EIO, "", "b"), "b")):
        with pytest.raises(OSError) as caught, whole(tmp_path / "a"):
            raise error
        assert caught.value.filename == str(name)
    assert not list(tmp_path.iterdir())


NOT_WRITTEN = {  # of commands that take longest, files and folders; /proc takes none, of root neither
    ("run", "shefex2_andoya", "--out"): ("/proc/run.mcap", "--out: cannot write into the folder /proc: "),
    ("verify", "bound", "orbit", "--out"): ("/proc/b.png", "--out: cannot write into the folder /proc: "),
    ("trade", "orbit", "--sweep", "gps.rate=1 Hz,2 Hz", "--figure"): ("/proc/t.png", "--figure: cannot"),
    ("campaign", "shefex2_dispersed", "--runs", "9", "--out"): ("/proc/none", "--out: cannot write into"),
    ("campaign", "shefex2_dispersed", "--runs", "9", "--sweep", "gps.rate=1 Hz,2 Hz", "--out"): (
        "{here}/file/sweep", "--out: {here}/file is a file; give the name of a folder",
    ),
    ("verify", "consistency", "orbit", "--keep"): ("/proc/none", "--keep: cannot write into"),
    ("verify", "robustness", "orbit", "--out"): ("/proc/none", "--out: cannot write into the folder /proc"),
    ("characterise", "night_sky", "--runs", "99", "--out", "{here}/s.json", "--records"): (
        "/proc/none", "--records: cannot write into the folder /proc",
    ),
    ("report", "LOG", "--figures"): ("/proc/none", "--figures: cannot write into the folder /proc"),
    ("export", "LOG", "--csv"): ("{here}/file", "--csv: {here}/file is a file; give the name of a folder"),
    ("report", "LOG", "--html"): (f"{{here}}/{248 * 'x'}.html", "has a name that is too long"),
    ("view", "LOG", "--force", "--screenshot"): ("{here}/folder.png", "folder.png is a folder"),
    ("export", "LOG", "--force", "--kml"): ("/dev/null", "--kml: /dev/null is a device; give"),
}  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="no /proc")
@pytest.mark.parametrize("words", NOT_WRITTEN, ids=" ".join)
def test_what_cannot_be_written_is_told_before_the_work(words, log, command, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    (tmp_path / "folder.png").mkdir()
    for place in ("warmup.get_ready", "log.reader.read"):  # which come first
        monkeypatch.setattr(f"shefex_nav.{place}", lambda *_, **__: pytest.fail("the work has begun"))
    place, said = (one.replace("{here}", str(tmp_path)) for one in NOT_WRITTEN[words])
    given = [str(log) if one == "LOG" else one.replace("{here}", str(tmp_path)) for one in words]
    done = command(*given, place)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1) and said in done.err, done.err
    assert {one.name for one in tmp_path.iterdir()} == {"file", "folder.png"}


@pytest.mark.parametrize("words", [("run", "night_sky", "--out"), ("report",), ("new", "filter"), ("check",)])
def test_names_that_are_too_long(words, command):
    name = 300 * "x" + (".py" if words[0] == "new" else ".yaml")
    done = command(*words, name)
    assert done.code == 2
    assert done.err.splitlines()[-1].startswith(f"{name}: cannot be")


@pytest.mark.parametrize("words", [("check",), ("run", "night_sky", "--out"), ("campaign", "x", "--out")])
def test_names_that_are_no_text(words, command):
    """Latin-1 where names are UTF-8: neither protobuf nor Parquet nor HTML could hold it."""
    done = command(*words, os.fsdecode(b"sk\xe4.yaml"))
    assert done.code == 2
    assert "is not valid utf-8; rename the file, or set LC_ALL to its encoding" in done.err


def test_a_folder_whose_name_is_no_text(log, tmp_path):
    folder = os.fsencode(tmp_path) + b"/sk\xe4"
    os.mkdir(folder)
    shutil.copy(log, folder + b"/night.mcap")
    assert shefex_nav("export", "night.mcap", "--csv", "tables", cwd=folder).returncode == 0
    assert os.path.exists(folder + b"/tables/truth.csv")


def test_letters_of_other_alphabets_in_the_plainest_locale(log, tmp_path):
    """Python itself reads C as UTF-8."""
    folder = tmp_path / "ä ß 火 箭"
    folder.mkdir()
    (folder / "скрипт α.yaml").write_text("# Night.\nextends: night_sky\nmission: {name: ночь}\n")
    assert shefex_nav("check", "скрипт α.yaml", cwd=folder, LC_ALL="C").returncode == 0
    done = shefex_nav("export", log, "--geojson", "след 1.json", cwd=folder, LC_ALL="C")
    assert done.returncode == 0 and (folder / "след 1.json").stat().st_size > 0


@pytest.mark.parametrize(
    ("without", "here"), [(("HOME", "XDG_CONFIG_HOME"), {}), ((), {"HOME": "/dev/null/nowhere"})]
)
def test_no_home(without, here, tmp_path):
    kernels = {"XDG_CACHE_HOME": os.environ.get("XDG_CACHE_HOME", os.path.expanduser("~/.cache"))}
    words = "run", "night_sky", "--until", "1s", "--out", tmp_path / "night.mcap"
    assert shefex_nav(*words, without=without, **kernels, **here).returncode == 0


@pytest.mark.parametrize("name", ["HOME", "XDG_CONFIG_HOME"])
def test_folders_of_astropy_that_are_not_there_are_not_its_warning(name, tmp_path):
    """A unit that the program does not know by itself is asked of astropy, which then warned."""
    told = {name: str(tmp_path / "none")}
    done = shefex_nav("check", "night_sky", "--set", "gps.rate=300 1/min", **told)
    lines = done.stderr.splitlines()
    assert done.returncode == 0 and all(line.startswith("star_camera: ") for line in lines)
