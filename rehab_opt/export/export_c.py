"""Write the controllers of a problem file as C."""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from rehab_opt.errors import ConfigurationError
from rehab_opt.export.c_source import files_of
from rehab_opt.export.exported import ExportedController
from rehab_opt.export.exporters import exported_controllers
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress

__all__ = ["export_c", "written_files"]

MARK = "Written by rehab-opt export-c"
"""In every header."""


def export_c(
    loaded: ProblemFile[Any],
    folder: Path,
    *,
    progress: Progress = lambda *_: None,
    writing: AbstractContextManager[None] | None = None,
) -> tuple[Path, ...]:
    """Write every file into a scratch folder, then move them into `folder`; what was written.

    A problem with several controllers gets a folder for each, named after it. Files of other names stay; those of
    these names are replaced where they are an earlier export's.

    Parameters
    ----------
    writing : held while files are written, when everything is computed.

    Raises
    ------
    ProblemFileError : the file's controller cannot be exported.
    ConfigurationError : as for `written_files`.
    OSError : the folder cannot be made or written to.
    """
    controllers = exported_controllers(loaded, progress=progress)
    places = [folder] if len(controllers) == 1 else [folder / controller.name for controller in controllers]
    with writing if writing is not None else nullcontext():
        return written_files(dict(zip(places, controllers, strict=True)), folder, problem=loaded.name)


def written_files(places: Mapping[Path, ExportedController], folder: Path, *, problem: str) -> tuple[Path, ...]:
    """Write every controller into its place, `folder` or a folder in it: all files or none.

    Raises
    ------
    ConfigurationError : a file that stands there is somebody else's, who may have no copy of it.
    OSError : as for `export_c`.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = folder if folder.is_dir() else folder.parent  # what is there may be mounted: no file moves into it
    written = []
    try:
        drafts = tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=beside)
    except OSError as refused:  # it would name a file that nobody asked for
        raise OSError(refused.errno, refused.strerror, str(folder)) from refused
    with drafts as scratch:
        for i, (place, controller) in enumerate(places.items()):
            for name, text in files_of(controller, problem=problem).items():
                draft = Path(scratch) / f"{i}-{name}"
                draft.write_text(text, encoding="utf-8")
                written.append((draft, place / name))
        for _, target in written:
            if target.is_dir():
                raise IsADirectoryError(errno.EISDIR, "Is a directory", str(target))
            if target.exists() and not _exported_before(target.parent):
                expected = "no such file, or an earlier export around it: it would be lost"
                raise ConfigurationError("DIR", str(target), expected)
        for draft, target in written:
            target.parent.mkdir(parents=True, exist_ok=True)
            draft.replace(target)
    return tuple(target for _, target in written)


def _exported_before(place: Path) -> bool:
    """Whether a folder holds an export, whose files may be replaced."""
    return any(MARK in header.read_text(encoding="utf-8", errors="replace") for header in place.glob("rehab_*.h"))
