"""Compiled kernels are kept as long as what they were made from stays, wherever it stands."""

import os
import shutil
import time

import numpy as np
import pytest
from kernel_package import LOWER, UPPER, Package

from shefex_nav import warmup
from shefex_nav.compiled import kernel, machine_code, numba_hooks, signature, store


@pytest.fixture
def copy(compiled_package, tmp_path):
    """A copy of the package in another folder, with a copy of its cache: (Package, first Result)."""
    original, first = compiled_package
    shutil.copytree(original.cache, tmp_path / "cache")
    return Package(tmp_path / "two", tmp_path / "cache"), first


def test_results_are_those_of_python(compiled_package):
    _, first = compiled_package
    assert (first.value, first.root) == ("34.0", "3.0")  # 2 (2 (1 + 2 + 4) + 3)
    assert len(first.saved) == 2 and not first.loaded


def test_in_another_folder_nothing_is_compiled(copy):
    package, first = copy
    again = package.run(PYTHONHASHSEED="7")
    assert not again.saved and len(again.loaded) == 2
    assert (again.total, again.other, again.value) == (first.total, first.other, first.value)


@pytest.mark.parametrize(
    "lower, upper",
    [
        (LOWER.replace("Product of two numbers", "The product"), UPPER),
        (LOWER.replace("  # of any sign", ""), UPPER.replace("x times the table, and y", "A sum")),
        ("# a line\n\n" + LOWER, "# a line\n" + UPPER),
        (LOWER.replace('    """Product of two numbers."""\n', ""), UPPER),
        (LOWER.replace("return a\n", "return 2 * a\n"), UPPER),  # of a function that nobody calls
        (
            LOWER.replace("def unused", "def spare"),
            UPPER.replace("import TABLE, product", "import product, TABLE"),
        ),
    ],
    ids=["docstring", "comment", "lines", "no docstring", "uncalled", "renamed"],
)
def test_what_changes_no_result_is_not_compiled_again(copy, lower, upper):
    package, first = copy
    package.write(lower, upper)
    again = package.run()
    assert not again.saved
    assert (again.total, again.other) == (first.total, first.other)


@pytest.mark.parametrize(
    "lower, upper, value",
    [
        (LOWER.replace("return a * b", "return a + b"), UPPER, "32.0"),  # in another file
        (LOWER.replace("4.0]", "5.0]"), UPPER, "38.0"),  # a table in another file
        (LOWER, UPPER.replace("n=2", "n=3"), "51.0"),
        (LOWER, UPPER.replace("pair.y)", "pair.y + 1)"), "36.0"),
        (LOWER, UPPER.replace("x: float\n    y: float", "y: float\n    x: float"), "46.0"),
        (LOWER, UPPER.replace("@kernel\ndef total", "@kernel(error_model='numpy')\ndef total"), "34.0"),
        (LOWER.replace("@inner\ndef product", "@inner(fastmath=True)\ndef product"), UPPER, "34.0"),
    ],
    ids=["callee", "table", "default", "constant", "fields", "options", "options of a callee"],
)
def test_what_changes_a_kernel_compiles_it_and_no_other(copy, lower, upper, value):
    package, first = copy
    package.write(lower, upper)
    again = package.run()
    assert again.value == value
    assert ["upper.total" in line for line in again.saved] == [True]
    assert ["upper.other" in line for line in again.loaded] == [True]
    if "x: float\n    y" in upper:  # the fields are part of the types of arguments, not of the kernel
        assert again.total != first.total
    assert again.other == first.other


def test_settings_of_the_compiler_have_files_of_their_own(copy):
    package, _ = copy
    assert len(package.run(NUMBA_BOUNDSCHECK="1").saved) == 2
    assert not package.run().saved


def test_a_damaged_file_is_told_once_and_compiled_again(copy):
    package, first = copy
    for file in package.cache.rglob("upper.total*"):
        file.write_bytes(file.read_bytes()[:-100] + bytes(100))
    again = package.run()
    assert again.value == first.value
    assert again.err.count("is damaged; the kernel is compiled again") == 1
    assert len(again.saved) == 1 and not package.run().saved


def test_a_folder_that_cannot_be_written_is_told_once(package):
    package.cache.write_text("a file where the folder should be", encoding="utf-8")
    done = package.run()
    assert done.value == "34.0" and not done.saved
    assert done.err.count("cannot be kept in") == 1 and "NUMBA_CACHE_DIR" in done.err


def test_two_processes_at_once_compile_each_kernel_once(package):
    processes = [package.start(), package.start()]
    done = [package.finish(process) for process in processes]
    assert {one.value for one in done} == {"34.0"}
    assert sum(len(one.saved) for one in done) == 2
    assert not [path for path in package.cache.rglob("*") if path.suffix in (".lock", ".part")]


def test_files_that_nobody_uses_are_deleted(tmp_path):
    kept = store.Store("kind", tmp_path)
    old_s = time.time() - 40.0 * store.DAY_S
    for n in range(7):
        path = kept.save(f"a.kernel-abc-{n}", b"code")
        os.utime(path, (old_s + n, old_s + n))
    kept.save("a.kernel-abc-new", b"code")
    kept.prune()
    left = {path.name for path in (tmp_path / "kind").iterdir()}
    assert left == {f"a.kernel-abc-{n}.kernel" for n in ("new", 6, 5, 4)}


def test_what_broke_off_is_deleted_after_a_day(tmp_path):
    kept = store.Store("kind", tmp_path)
    kept.save("a.kernel-abc-1", b"code")
    os.symlink(tmp_path / "nowhere", tmp_path / "kind" / "gone.kernel")  # as if deleted meanwhile
    for name in ("old.lock", "old.part", "new.lock", "new.part"):
        path = tmp_path / "kind" / name
        path.touch()
        if name.startswith("old"):
            os.utime(path, (time.time() - 1.1 * store.DAY_S,) * 2)
    kept.prune()
    left = {path.name for path in (tmp_path / "kind").iterdir()}
    assert left == {"a.kernel-abc-1.kernel", "gone.kernel", "new.lock", "new.part"}


def test_a_file_that_cannot_be_marked_as_used_is_good(tmp_path, monkeypatch, capsys):
    kept = store.Store("kind", tmp_path)
    os.utime(kept.save("one", b"code"), (0.0, 0.0))

    def refuse(path):
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "utime", refuse)
    assert kept.load("one") == b"code" and not capsys.readouterr().err


def test_what_a_package_brings_is_found(tmp_path, monkeypatch):
    shipped = tmp_path / "site" / store.SHIPPED
    (shipped / "kind").mkdir(parents=True)
    shipped.joinpath("__init__.py").write_text("", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path / "site")
    kept = store.Store("kind", tmp_path / "own")
    kept.save("one", b"mine")
    os.rename(kept.path("one"), shipped / "kind" / "one.kernel")
    assert kept.load("one") == b"mine" and not list((tmp_path / "own" / "kind").iterdir())
    assert kept.load("two") is None


@pytest.mark.parametrize(("more", "expected"), [([], []), (["no_such_name"], ["runtime", "all"])])
def test_numba_is_set_up_for_code_that_names_what_is_missing(monkeypatch, more, expected):
    assert numba_hooks.cpu_target.target_context  # which brings the names of Python
    done = []

    class Context:
        def refresh(self):
            done.append("all")

    monkeypatch.setattr(machine_code.rtsys, "initialize", lambda context: done.append("runtime"))
    machine_code.provide(Context(), ["PyErr_SetString", *more])
    assert done == expected


def test_environments_are_kept_that_code_asks_for():
    """Named once: declared, for a function that is no more; `other` has constants, whoever asks for them."""

    class One:
        def __init__(self, name, consts=()):
            self.env_name, self.consts = f"_ZN08NumbaEnv{name}", consts

    class Result:
        def _find_referenced_environments(self):
            return [One("5first"), One("5first3_2b"), One("6second"), One("5other", [1])]

    text = """
    @_ZN08NumbaEnv5first = common global ptr null
    @_ZN08NumbaEnv5first3_2b = common global ptr null
    @"_ZN08NumbaEnv6second" = common global ptr null
    @_ZN08NumbaEnv5other = common global ptr null
    @words = constant c"missing Environment: _ZN08NumbaEnv5first"
    %1 = load ptr, ptr @"_ZN08NumbaEnv6second", align 8
    """
    kept = machine_code.environments(Result(), text)
    assert [one.env_name for one in kept] == ["_ZN08NumbaEnv6second", "_ZN08NumbaEnv5other"]


def test_a_kernel_that_cannot_be_kept_is_told_and_not_listed(tmp_path, monkeypatch, capsys):
    """A type of argument without a name, as of a random generator: it is compiled in every process."""
    told, times = [], kernel(lambda rng: 2.0 * rng.random())
    listens = [lambda *given: told.append(given), warmup._say_late]
    monkeypatch.setattr(numba_hooks, "begins_to_compile", listens)
    assert 0.0 <= times(np.random.default_rng(1)) < 2.0
    assert told == [(times, False)]
    said = capsys.readouterr().err
    assert "every process compiles it anew" in said and "later runs" not in said
    monkeypatch.setenv(numba_hooks.USES, str(tmp_path / "used.jsonl"))
    with pytest.raises(signature.UnknownType, match="NumPyRandomGenerator"):
        kernel(lambda rng: 3.0 * rng.random())(np.random.default_rng(1))
