"""Builds the wheel shefex-nav-kernels: the compiled kernels of this shefex-nav, for this Python and platform.

    python .ci/kernels_wheel.py dist/       # compiles every listed kernel anew, then writes one wheel

The kernels are files of data in a package without code; shefex_nav finds them when it is imported, and
compiles by itself where versions or platform differ from those that the wheel names. To be run with the
environment for which the wheel is meant; needs `build` and `hatchling`.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from importlib.metadata import distribution, version
from pathlib import Path

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
        project, cache = Path(folder, "project"), Path(folder, "cache")
        package = project / "shefex_nav_kernels"
        package.mkdir(parents=True)
        compile_all(cache)
        for kind in (cache / "shefex_nav").iterdir():
            shutil.copytree(kind, package / kind.name)
        write_project(project)
        subprocess.run(
            [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", out, project], check=True
        )


def compile_all(cache):
    """Compile every listed kernel into an empty folder."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    subprocess.run([sys.executable, "-m", "shefex_nav", "warmup"], env=environment, check=True)


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
