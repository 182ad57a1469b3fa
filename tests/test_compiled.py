"""A kernel that uses code of another file is compiled again when that file is edited."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from shefex_nav import compiled

PACKAGE = Path(compiled.__file__).parent


def is_kernel(node):
    return isinstance(node, ast.FunctionDef) and any("njit" in ast.dump(d) for d in node.decorator_list)


def files_with_kernels():
    """(path, {name imported from the package: (module, name)}, names in its kernels) of each such file.

    A constant of the file that a kernel uses brings along the names from which it is made.
    """
    for path in sorted(PACKAGE.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if "njit" not in source:
            continue
        tree = ast.parse(source)
        imported = {
            alias.asname or alias.name: (node.module, alias.name)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "shefex_nav"
            for alias in node.names
        }
        used = set().union(*(names(node) for node in tree.body if is_kernel(node)))
        made = {node for node in tree.body if isinstance(node, ast.Assign)}
        while more := {node for node in made if any(used & names(target) for target in node.targets)}:
            used = used.union(*(names(node.value) for node in more))
            made -= more
        yield path, imported, used


def names(node):
    """All names in a part of a program."""
    return {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}


def file_of(module, name):
    """The file from which `from module import name` takes its code."""
    place = PACKAGE.parent.joinpath(*module.split("."))
    for path in (place / f"{name}.py", place / name / "__init__.py", place.with_suffix(".py")):
        if path.exists():
            return path
    return place / "__init__.py"


def used_elsewhere():
    """(file of a kernel, name, file of the name) for each name of another file in a kernel."""
    for path, imported, used in files_with_kernels():
        for name in sorted(used & set(imported)):
            yield path, name, file_of(*imported[name])


def shared(path):
    """The entry of SHARED that has a file."""
    place = path.relative_to(PACKAGE)
    return place.as_posix() if len(place.parts) == 1 else place.parent.as_posix()


def test_code_that_kernels_share_is_in_the_hash_of_their_cache():
    """numba looks at a kernel's own file alone: without the hash, an edit elsewhere would leave old code."""
    uses = list(used_elsewhere())
    assert len(uses) > 50  # or this test does not see them
    missing = {
        f"{path.relative_to(PACKAGE)} uses {name} of {source.relative_to(PACKAGE)}"
        for path, name, source in uses
        if shared(source) not in compiled.SHARED
    }
    assert not missing
    assert {shared(source) for _, _, source in uses} == set(compiled.SHARED)  # nor is one there in vain


def test_the_hash_follows_an_edit_in_each_shared_place(tmp_path):
    files = [
        tmp_path / place if place.endswith(".py") else tmp_path / place / "kernel.py"
        for place in compiled.SHARED
    ]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("A = 1\n")
    keys = [compiled.cache_key(tmp_path)]
    for file in files:
        file.write_text("A = 2\n")
        keys.append(compiled.cache_key(tmp_path))
    assert len(set(keys)) == 1 + len(compiled.SHARED)


def test_fields_of_rows_do_not_hide_behind_what_numpy_has():
    """As Python, `row.mean` would be a method: what a kernel reads must not depend on how it runs."""
    plain = compiled.rows([("run", float), ("state", int)])
    assert plain.names == ("run", "state")
    row = np.zeros(1, dtype=np.dtype((np.record, plain)))[0]
    row.run = 2.0
    assert row.run == row["run"] == 2.0
    with pytest.raises(ValueError, match="fields mean, T: NumPy's rows have attributes of these names"):
        compiled.rows([("mean", float), ("run", float), ("T", float)])


def test_kernels_run_as_python(tmp_path):
    """Rows have attributes where nothing is compiled, and what is written into one is in its table."""
    code = (
        "import numpy as np\n"
        "from shefex_nav.onboard.navigation import integrity_imu as it\n"
        "watch = it.start(it.NO_RULES, 4)\n"
        "it._charge(1.0, 1.0, watch.axes[2], 5.0)\n"
        "watch.axes[3].mean_rate = 7.0\n"
        "assert watch.axes['mean_rate'][3] == 7.0 and type(watch.axes[0]) is np.record\n"
        "assert not hasattr(it._charge, 'py_func')\n"
    )
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
