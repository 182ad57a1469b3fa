"""Builds the wheel shefex-nav-kernels: the compiled kernels of this shefex-nav, for this Python and platform.

    uv run python .ci/kernels_wheel.py dist/

The kernels are files of data in a package without code; shefex_nav finds them when it is imported, and
compiles by itself where versions or platform differ from those that the wheel names. To be run with the
environment for which the wheel is meant; needs `build` and `hatchling`.
"""

import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import distribution, version
from pathlib import Path

from shefex_nav import warmup
from shefex_nav.compiled import ahead, signature
from shefex_nav.compiled.numba_hooks import store

PROJECT = """\
[build-system]
requires = ["hatchling>=1.27"]
build-backend = "hatchling.build"

[project]
name = "shefex-nav-kernels"
version = "{version}"
description = "Compiled kernels of shefex-nav {version}, so that the first run does not compile"
license = "MIT"
requires-python = "=={python}.*"
dependencies = [
    "shefex-nav=={version}", "numba=={numba}", "llvmlite=={llvmlite}", "numpy=={numpy}.*",
]

[tool.hatch.build.targets.wheel]
packages = ["shefex_nav_kernels"]

[tool.hatch.build.targets.wheel.hooks.custom]
"""
HOOK = """\
from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Tag(BuildHookInterface):
    def initialize(self, version, build_data):
        build_data["pure_python"], build_data["tag"] = False, "{tag}"
"""


def main():
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "dist").resolve()
    with tempfile.TemporaryDirectory() as folder:
        project = Path(folder)
        place = project / "shefex_nav_kernels" / store().kind
        place.mkdir(parents=True)
        for file in compiled():
            shutil.copyfile(file, place / Path(file).name)
        write_project(project)
        command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", out, project]
        subprocess.run(command, check=True)


def compiled():
    """Files of all listed kernels; what is missing is compiled."""
    wanted = ahead.entries()
    warmup.compile_listed(ahead.without_file(wanted))
    for one in wanted:
        yield signature.find(one.kernel).file_of(tuple(map(signature.decode, one.signature)))


def write_project(project):
    """Files from which the wheel is built."""
    versions = {name: version(name) for name in ("numba", "llvmlite")}
    versions["numpy"] = ".".join(version("numpy").split(".")[:2])
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    text = PROJECT.format(version=version("shefex-nav"), python=python, **versions)
    project.joinpath("pyproject.toml").write_text(text, encoding="utf-8")
    project.joinpath("hatch_build.py").write_text(HOOK.format(tag=tag()), encoding="utf-8")
    words = '"""Compiled kernels of shefex-nav: data only."""\n'
    project.joinpath("shefex_nav_kernels", "__init__.py").write_text(words, encoding="utf-8")


def tag():
    """Tag of the wheel: this Python, and the platform of the wheel from which llvmlite was installed."""
    lines = distribution("llvmlite").read_text("WHEEL").splitlines()
    platforms = [line.rsplit("-", 1)[1] for line in lines if line.startswith("Tag:")]
    return f"cp{sys.version_info.major}{sys.version_info.minor}-none-{'.'.join(platforms)}"


if __name__ == "__main__":
    main()
