"""Write controllers as C: a controller made in Python, or those of a problem file."""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from rehab_opt.errors import ConfigurationError
from rehab_opt.export.c_source import files_of
from rehab_opt.export.exported import ExportedController
from rehab_opt.export.exporters import exported_controllers
from rehab_opt.session.files import ProblemFile
from rehab_opt.session.outcome import Progress
from rehab_opt.session.report import checked_folder

__all__ = ["export_c", "written_files"]

MARK = "Written by rehab-opt export-c"
"""Text in every header, by which an export is recognised."""


def export_c(
    controller: object,
    folder: str | Path,
    *,
    run: Sequence[Mapping[str, Any]] | None = None,
    memory: int | None = None,
    progress: Progress = lambda *_: None,
    writing: AbstractContextManager[None] | None = None,
) -> tuple[Path, ...]:
    """Write a controller as C (source, header, and a recorded run that C repeats); returns the written files.

    The header has the joints' names and limits, `dt`, the version of this library, and a hash of the model. For a pair,
    or a problem with several controllers, each controller gets a folder. Only files of an earlier export are replaced.

    Parameters
    ----------
    controller : a `PoseTracker`, `MirrorTracker`, `RedundancyResolver`, `Assistance`, `PathAssistance` or `Bilateral`,
        also with your own `limits`, or a loaded problem file. It is reset before and after. Its solver must be qrqp,
        the default; C has no backup solver.
    folder : target; created if missing.
    run : ticks that C repeats with faults added, each with the arguments of `step` by name: q, pose, twist and
        obstacles for trackers; q, twist, rows, frame and moving for a resolver; x for forces. Joints move as commanded
        from the first tick's q. Stamps, forces and the enable input are generated. By default a random run, or that of
        the problem file.
    memory : [bytes] largest size of the C struct. For a `MirrorTracker` (default 96 kB) the buffer of reference samples
        takes the memory that remains; other controllers have a fixed size.
    writing : context that is active while files are written.

    Raises
    ------
    ConfigurationError : a controller without C code or with a larger struct; a run that lacks arguments of `step`; an
        invalid folder, or one with a file that is not from an earlier export.
    ProblemFileError : a problem file without an exportable controller.
    OSError : the folder cannot be created or written to.
    """
    if memory is not None and not (type(memory) is int and memory > 0):
        raise ConfigurationError("memory", memory, "a number of bytes above zero")
    if not isinstance(folder, str | Path):
        raise ConfigurationError("folder", folder, "a path: str or Path")
    target = checked_folder(Path(folder), argument="folder")
    if isinstance(controller, ProblemFile):
        if run is not None:
            raise ConfigurationError("run", f"{len(run)} ticks", "None: a problem file has a run of its own")
        controllers, name = exported_controllers(controller, memory=memory, progress=progress), controller.name
    else:
        from rehab_opt.export.of_objects import exported_object  # noqa: PLC0415  (loads every controller)

        controllers = exported_object(controller, run=run, memory=memory, progress=progress)
        name = f"a {type(controller).__name__} of Python"
    for each in controllers:
        if memory is not None and each.bytes > memory:
            raise ConfigurationError("memory", memory, f"at least {each.bytes} bytes, which {each.name} takes")
    places = [target] if len(controllers) == 1 else [target / each.name for each in controllers]
    with writing if writing is not None else nullcontext():
        return written_files(dict(zip(places, controllers, strict=True)), target, problem=name)


def written_files(places: Mapping[Path, ExportedController], folder: Path, *, problem: str) -> tuple[Path, ...]:
    """Write the files of every controller into `folder` or its subfolders: either all of them or none.

    Raises
    ------
    ConfigurationError : an existing file is not from an earlier export.
    OSError : as for `export_c`.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    beside = folder if folder.is_dir() else folder.parent  # on the same file system, so that files can be moved
    written = []
    try:
        drafts = tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=beside)
    except OSError as refused:  # the original names a scratch file; the new error names the folder
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
    return any(MARK in header.read_text(encoding="utf-8", errors="replace") for header in place.glob("rehab_*.h"))
