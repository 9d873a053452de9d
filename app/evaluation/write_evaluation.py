"""An evaluation on disk: written beside its place, then moved there, so that nothing half-written is left behind."""

from __future__ import annotations

import json
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

from app.errors import InputError
from app.evaluation.evaluation import Evaluation

FIGURES = "evaluation.json"


def check_writable(output: Path | None, file: Path | None) -> None:
    """Raise `InputError` for places that cannot be written to, before any work is done."""
    if output is not None and output.exists() and not output.is_dir():
        raise InputError(f"{output} is no folder", field="output", advice="Name a folder for the plots.")
    for place, field in ((output, "output"), (file, "json")):
        if place is not None and not place.absolute().parent.is_dir():
            raise InputError(f"{place.absolute().parent} is not there", field=field, advice="Make the folder first.")
    if file is not None and file.is_dir():
        raise InputError(f"{file} is a folder", field="json", advice="Name a file.")
    for place, field in ((output, "output"), (file, "json")):
        if place is not None:
            folder = place if place.is_dir() else place.absolute().parent
            try:
                tempfile.TemporaryFile(dir=folder).close()
            except OSError as error:
                raise InputError(f"{folder} cannot be written: {error.strerror}", field=field) from error


def write_figures(found: Evaluation, file: Path) -> None:
    """The machine-readable form (`Evaluation.as_dict`).

    Raises:
        InputError: it cannot be written.
    """
    text = json.dumps(found.as_dict(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    beside = file.with_name(f".{file.name}.part")
    try:
        beside.write_text(text, encoding="utf-8")
        beside.replace(file)
    except OSError as error:
        raise InputError(f"{file} cannot be written: {error.strerror or error}", field="json") from error
    finally:
        with suppress(OSError):
            beside.unlink()


def write_folder(found: Evaluation, output: Path) -> None:
    """Figures and plots; files of an earlier evaluation with the same names are replaced.

    Raises:
        InputError: it cannot be written.
    """
    from app.evaluation.plots import write_plots

    try:
        draft = Path(tempfile.mkdtemp(prefix=f".{output.name}-", dir=output.absolute().parent))
        try:
            write_figures(found, draft / FIGURES)
            names = [*write_plots(found.measured, draft), FIGURES]
            output.mkdir(exist_ok=True)
            for name in names:
                (draft / name).replace(output / name)
        finally:
            shutil.rmtree(draft, ignore_errors=True)
    except OSError as error:
        raise InputError(f"{output} cannot be written: {error.strerror or error}", field="output") from error
