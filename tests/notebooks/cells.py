"""The cells of the notebooks, executed here as a kernel would, without one."""

import ast
import json
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "notebooks"


def read(name):
    """Cells of a notebook: list of dict."""
    return json.loads((FOLDER / f"{name}.ipynb").read_text())["cells"]


def code(name):
    """(source without lines for IPython alone, whether it sets the parameters) of each code cell."""
    for cell in read(name):
        if cell["cell_type"] == "code":
            lines = "".join(cell["source"]).splitlines()
            source = "\n".join(line for line in lines if not line.startswith("%"))
            yield source, "parameters" in cell["metadata"].get("tags", ())


def execute(name, monkeypatch, **parameters):
    """Execute a notebook in its folder with other parameters than it has. -> its variables

    Figures that it shows are laid out; what stands at the end of a cell must be something to show.
    """
    import matplotlib.pyplot as plt

    def show():
        for number in plt.get_fignums():
            plt.figure(number).draw_without_rendering()
        plt.close("all")

    monkeypatch.chdir(FOLDER)
    monkeypatch.setattr(plt, "show", show)
    known, given = {"__name__": "__main__"}, set()
    for source, has_parameters in code(name):
        shown = _run(source, known)
        if hasattr(shown, "draw_without_rendering"):
            shown.draw_without_rendering()
        if has_parameters:
            given |= parameters.keys() & known.keys()
            known.update(parameters)
    assert given == parameters.keys(), "the notebook has no such parameter"
    return known


def _run(source, known):
    """Execute a cell. -> value of its last line, None if that is no expression"""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "<cell>", "exec"), known)
    return eval(compile(ast.Expression(last.value), "<cell>", "eval"), known) if last else None
