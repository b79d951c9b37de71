"""The notebooks are what the examples make, and run from their first cell to the last."""

import importlib.util
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "examples" / "notebooks"
SPEC = importlib.util.spec_from_file_location("make_notebooks", FOLDER / "make.py")
MAKE = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(MAKE)


@pytest.mark.parametrize("name", MAKE.NOTEBOOKS)
def test_a_notebook_is_what_its_example_makes(name):
    written = (FOLDER / f"{name}.ipynb").read_text(encoding="utf-8")
    assert written == MAKE.notebook(name), "run `python examples/notebooks/make.py`"
    assert len(MAKE.NOTEBOOKS) == 6


@pytest.mark.slow
@pytest.mark.parametrize("name", MAKE.NOTEBOOKS)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_runs(name, tmp_path, monkeypatch):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    if name in MAKE.EXTRAS:
        pytest.importorskip(MAKE.EXTRAS[name])
    monkeypatch.setenv("EXAMPLE_STEPS", "24576")
    content = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    nbformat.validate(content)
    done = nbclient.NotebookClient(content, timeout=900, resources={"metadata": {"path": str(tmp_path)}}).execute()
    said = [out for cell in done.cells if cell.cell_type == "code" for out in cell.outputs]
    assert any("text" in out for out in said) and all(out.output_type != "error" for out in said)
