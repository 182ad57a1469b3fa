"""What is committed of the notebooks: pictures, and nothing that belongs to one machine."""

import json
import re
from pathlib import Path

import pytest
from cells import FOLDER, read

NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))
MOST_BYTES = 6e6
OF_A_MACHINE = re.compile(r"/(tmp|home|root|work|Users)/|site-packages|ipykernel|Warning|Traceback")


def outputs(name):
    """Outputs of the cells of a notebook."""
    return [output for cell in read(name) for output in cell.get("outputs", [])]


def texts(output):
    """Everything in an output that is text: list of str."""
    data = {kind: value for kind, value in output.get("data", {}).items() if not kind.startswith("image/")}
    return ["".join(value) for value in [output.get("text", ""), *data.values()]]


def test_notebooks_are_numbered_without_a_gap():
    assert [int(name[:2]) for name in NAMES] == list(range(1, len(NAMES) + 1))


def test_notebooks_are_small_enough_for_a_repository():
    assert sum((FOLDER / f"{name}.ipynb").stat().st_size for name in NAMES) < MOST_BYTES


@pytest.mark.parametrize("name", NAMES)
def test_cells_were_executed_in_order_and_have_pictures(name):
    counts = [cell["execution_count"] for cell in read(name) if cell["cell_type"] == "code"]
    assert counts == list(range(1, len(counts) + 1))
    assert any(kind.startswith("image/") for output in outputs(name) for kind in output.get("data", {}))


@pytest.mark.parametrize("name", NAMES)
def test_outputs_have_neither_errors_nor_warnings_nor_paths(name):
    for output in outputs(name):
        assert output["output_type"] != "error"
        assert output.get("name") != "stderr"
        for text in texts(output):
            assert not OF_A_MACHINE.search(text), text


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name):
    words = "".join("".join(cell["source"]) for cell in read(name) if cell["cell_type"] == "markdown")
    for target in re.findall(r"\]\(([^)#]+)\)", words):
        assert target.startswith("http") or (FOLDER / target).exists(), target


def test_the_readme_names_notebooks_that_exist():
    root = Path(FOLDER).parent
    for target in re.findall(r"\((notebooks/[^)]+)\)", (root / "README.md").read_text()):
        assert (root / target).exists(), target


def test_kernels_are_plain():
    for name in NAMES:
        metadata = json.loads((FOLDER / f"{name}.ipynb").read_text())["metadata"]
        assert metadata["kernelspec"]["name"] == "python3"
