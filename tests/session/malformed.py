"""Spoilt recordings whose truth their maker knows: `python -m tests.session.malformed 100000 SEED`.

A recording is made, written in some format, and spoilt in its structure. What must come of it is known: the very
samples, or a refusal; or another meaning of the samples, which a note or a refusal must tell of (`TOLD`).
"""

from __future__ import annotations

import sys
import tempfile
import time as clock
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rehab_opt.errors import ProblemFileError
from rehab_opt.recordings.reading import read_recording
from tests.session.made_c3d import c3d

SAME, REFUSED, TOLD = "same", "refused", "told"
SECRET = "S3cret"
LONGEST = 10.0
"""[s] for one file."""
Rng = np.random.Generator


class Made(NamedTuple):
    """A spoilt file: what was done to it, what must come of it, and the samples (N,) [s], (N, d) [m] that it holds."""

    what: str
    content: bytes
    others: dict[str, str]
    name: str
    reading: dict[str, Any]
    truth: str
    time: np.ndarray
    points: np.ndarray


class Table(NamedTuple):
    """A text format: lines above, cells of a header and of rows, and where time and coordinates stand in them."""

    above: list[str]
    header: list[str]
    rows: list[list[str]]
    mark: str
    suffix: str
    time: int | None
    places: list[int]
    reading: dict[str, Any]
    others: dict[str, str]


def movement(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """A reach of some decimetres with a sway, at an even rate; no two samples alike."""
    count = int(rng.integers(12, 40))
    time = np.arange(count) / float(rng.choice([50.0, 100.0, 120.0]))
    u = np.linspace(0, 1, count)
    along = np.outer(10 * u**3 - 15 * u**4 + 6 * u**5, rng.uniform(0.1, 0.4, 3) * rng.choice([-1, 1], 3))
    return time.round(6), (along + 0.01 * np.sin(7 * u)[:, None] * rng.uniform(0.5, 1, 3)).round(6)


def csv_table(rng: Rng, time: np.ndarray, points: np.ndarray) -> Table:
    name, mark = [("comma", ","), ("semicolon", ";"), ("tab", "\t")][int(rng.integers(3))]
    comma = name != "comma" and rng.random() < 0.5
    unit, scale = [("m", 1.0), ("cm", 1e2), ("mm", 1e3)][int(rng.integers(3))]
    rows = [
        [f"{t:.6f}", *(f"{scale * x:.6f}" for x in p[:2]), f"{SECRET}{i}"]
        for i, (t, p) in enumerate(zip(time, points, strict=True))
    ]
    if comma:
        rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    reading = {"separator": name, "decimal": "comma" if comma else "point"}
    return Table([], ["t_s", f"x_{unit}", f"y_{unit}", "comment"], rows, mark, "a.csv", 0, [1, 2], reading, {})


def storage_table(rng: Rng, time: np.ndarray, points: np.ndarray) -> Table:
    suffix = str(rng.choice(["a.mot", "a.sto"]))
    above = ["Coordinates", "version=1", f"nRows={len(time)}", "nColumns=5", "inDegrees=yes", "endheader"]
    rows = [[f"{t:.6f}", *(f"{x:.6f}" for x in p), f"{40 + 100 * t:.6f}"] for t, p in zip(time, points, strict=True)]
    columns = ["hand_tx", "hand_ty", "hand_tz"]
    return Table(above, ["time", *columns, "elbow"], rows, "\t", suffix, 0, [1, 2, 3], {"columns": columns}, {})


def motion_table(rng: Rng, time: np.ndarray, points: np.ndarray) -> Table:
    unit, scale = [("m", 1.0), ("cm", 1e2), ("mm", 1e3)][int(rng.integers(3))]
    rows = [[f"{t:.6f}", *(f"{scale * x:.6f}" for x in p), "0.5"] for t, p in zip(time, points, strict=True)]
    channels = ["name\tcomponent\ttype\ttracked_point\tunits", "t\tn/a\tLATENCY\tn/a\ts"]
    channels += [f"h{axis}\t{axis}\tPOS\thand\t{unit}" for axis in "xyz"] + ["e\tn/a\tJNTANG\telbow\trad"]
    others = {"a_channels.tsv": "\n".join(channels) + "\n", "a_motion.json": '{"SamplingFrequency": 100}'}
    return Table([], [], rows, "\t", "a_motion.tsv", 0, [1, 2, 3], {}, others)


def trc_table(rng: Rng, time: np.ndarray, points: np.ndarray) -> Table:
    above = ["PathFileType\t4\t(X/Y/Z)\ta.trc", "DataRate\tNumFrames\tUnits", f"100\t{len(time)}\tmm"]
    above += ["Frame#\tTime\tHAND\t\t\tHEAD\t\t", "\t\tX1\tY1\tZ1\tX2\tY2\tZ2"]
    rows = [
        [str(i + 1), f"{t:.6f}", *(f"{1e3 * x:.6f}" for x in p), "1", "2", "3"]
        for i, (t, p) in enumerate(zip(time, points, strict=True))
    ]
    return Table(above, [], rows, "\t", "a.trc", 1, [2, 3, 4], {"marker": "HAND"}, {})


TABLES: list[Callable[[Rng, np.ndarray, np.ndarray], Table]] = [csv_table, storage_table, motion_table, trc_table]


def spoilt_table(rng: Rng) -> Made:  # noqa: PLR0912  (a branch a fault)
    """A table with one of the faults that tables have."""
    time, points = movement(rng)
    made = TABLES[int(rng.integers(len(TABLES)))](rng, time, points)
    points = points[:, : len(made.places)]
    rows, header, mark, truth = [list(row) for row in made.rows], list(made.header), made.mark, SAME
    at, end = int(rng.integers(1, len(rows) - 1)), "\n"
    read = [place for place in (made.time, *made.places) if place is not None]
    place = int(rng.choice(read))
    tail = ""
    others = dict(made.others)
    keep = np.ones(len(rows), dtype=bool)
    faults = [
        "none",
        "cell gone",
        "cell more",
        "no number",
        "row twice",
        "row back",
        "row gone",
        "rows cut",
        "line cut",
    ]
    faults += ["ends", "nul", "no utf-8", "huge", "empty", "no rows"]
    faults += ["columns swapped", "header twice", "unit", "time for x"] if header else []
    faults += ["channels cut", "unit of a channel"] if others else []
    faults += ["degrees for radians", "radians for degrees"] if made.suffix in ("a.mot", "a.sto") else []
    fault = str(rng.choice(faults))
    content: bytes | None = None
    if fault == "cell gone":
        del rows[at][place]
        truth = REFUSED
    elif fault == "cell more":
        rows[at].insert(place, rows[at][place])
        truth = REFUSED
    elif fault == "no number":
        rows[at][place] = str(rng.choice(["abc", "1_0", "0x10", "--1", "1.2.3", "1e", "\u0661", "nan ms"]))
        truth = REFUSED
    elif fault == "huge":
        rows[at][place] = str(rng.choice(["1e9999", "123456789012345", "-inf", "-9999"]))
        truth = TOLD
    elif fault == "row twice":
        rows.insert(at, list(rows[at]))
    elif fault == "row back":
        rows[at], rows[at + 1] = rows[at + 1], rows[at]
        truth = REFUSED
    elif fault == "row gone":
        del rows[at]
        keep[at] = False
    elif fault == "rows cut":
        del rows[at + 1 :]
        keep[at + 1 :] = False
    elif fault == "line cut":
        del rows[at + 1 :]
        rows[at] = rows[at][: max(place, 1)]
        truth = REFUSED
    elif fault == "ends":
        end, tail = str(rng.choice(["\r\n", "\n"])), str(rng.choice(["\n\n", "", "\n \n"]))
    elif fault == "columns swapped":
        order = rng.permutation(len(header))
        header, rows = [header[i] for i in order], [[row[i] for i in order] for row in rows]
    elif fault == "header twice":
        header[place] = header[read[0] if place != read[0] else read[1]]
        truth = REFUSED
    elif fault == "unit" and made.suffix == "a.csv":
        header = [cell.rpartition("_")[0] + "_um" if cell[:2] in ("x_", "y_") else cell for cell in header]
        truth = REFUSED
    elif fault == "time for x" and made.suffix == "a.csv":
        header[0], header[1] = header[1], header[0]
        truth = TOLD
    elif fault == "degrees for radians":
        made.above[4] = "inDegrees=no"
        truth = TOLD
    elif fault == "radians for degrees":
        rows = [[*row[:-1], f"{np.radians(float(row[-1])):.6f}"] for row in rows]
        truth = TOLD
    elif fault == "channels cut":
        lines = others["a_channels.tsv"].splitlines()
        del lines[int(rng.integers(len(lines)))]
        others["a_channels.tsv"] = "\n".join(lines)
        truth = REFUSED
    elif fault == "unit of a channel":
        others["a_channels.tsv"] = others["a_channels.tsv"].replace("POS\thand\t", "POS\thand\tk")
        truth = REFUSED
    elif fault == "no rows":
        rows, truth = [], REFUSED
    lines = [*made.above, *([mark.join(header)] if header else []), *(mark.join(row) for row in rows)]
    content = (end.join(lines) + end + tail).encode()
    if fault in ("nul", "no utf-8"):
        middle = len(content) // 2
        content = content[:middle] + (b"\0" if fault == "nul" else b"\xff") + content[middle:]
        truth = REFUSED
    elif fault == "empty":
        content, truth = b"", REFUSED
    what = f"{made.suffix}, {fault}"
    return Made(what, content, others, made.suffix, made.reading, truth, time[keep], points[keep])


def spoilt_c3d(rng: Rng) -> Made:
    """A C3D cut short, of another unit, with its marker twice or not at all, of a subject, or with hidden frames."""
    time, points = movement(rng)
    frames = np.zeros((len(time), 2, 4))
    frames[:, 1, :3] = 1e3 * points
    keep = np.ones(len(time), dtype=bool)
    fault, truth = (
        str(rng.choice(["none", "cut", "unit", "marker", "twins", "subject", "hidden", "magic", "processor"])),
        REFUSED,
    )
    if fault == "hidden":
        keep[int(rng.integers(1, len(time) - 1))] = False
        frames[~keep, 1, 3] = -1
    subject = f"{SECRET}:" if fault == "subject" else ""
    content = c3d(frames, [f"{subject}HEAD", f"{subject}HAND"], order=str(rng.choice(["<", ">"])))
    if fault == "cut":
        content = content[: int(rng.integers(len(content)))]
    elif fault == "unit":
        content = content.replace(b"mm", b"km")
    elif fault == "marker":
        content = content.replace(b"HAND", b"HEEL")
    elif fault == "twins":
        content = content.replace(b"HEAD", b"HAND")
    elif fault == "magic":
        content = content[:1] + b"Q" + content[2:]
    elif fault == "processor":
        content = content[:515] + bytes([int(rng.choice([0, 83, 85, 87, 255]))]) + content[516:]
    else:
        truth = SAME
    times = np.arange(len(time)) / 100
    return Made(f"a.c3d, {fault}", content, {}, "a.c3d", {"marker": "HAND"}, truth, times[keep], points[keep])


def check(made: Made, folder: Path) -> str:  # noqa: PLR0911  (a return a wrong end)
    """Read a spoilt file; "" where that ends as it must, else what is wrong."""
    for name, content in {made.name: made.content, **{k: v.encode() for k, v in made.others.items()}}.items():
        (folder / name).write_bytes(content)
    began = clock.process_time()
    try:
        read = read_recording(folder / made.name, **made.reading)
    except ProblemFileError as refused:
        read, said = None, str(refused)
    if clock.process_time() - began > LONGEST:
        return "a hang"
    if read is None:
        if made.truth == SAME:
            return f"refused: {said}"
        if SECRET in said or len(said) > 600:
            return f"tells more than the cell at fault: {said}"
        return ""
    if made.truth == REFUSED:
        return "read"
    if made.truth == TOLD:
        words = ("left out", "jump") if made.what.endswith("huge") else ("unit", "taken")
        return "" if any(word in note for note in read.notes for word in words) else "not told of"
    if read.points.shape != made.points.shape or not np.allclose(read.points, made.points, atol=1e-6):
        return "other points"
    shift = read.time[0] - made.time[0]
    return "" if np.allclose(read.time - shift, made.time, atol=2e-4) else "other times"


def malformed(count: int, seed: int) -> tuple[Counter[str], Counter[str]]:
    """Make and read so many files: how many of each fault, and of each wrong end."""
    rng = np.random.default_rng(seed)
    makers = [spoilt_table, spoilt_table, spoilt_table, spoilt_table, spoilt_c3d]
    made_of, wrong = Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(count):
            made = makers[int(rng.integers(len(makers)))](rng)
            made_of[made.what] += 1
            problem = check(made, Path(folder))
            if problem:
                wrong[f"{made.what}: {problem[:160]}"] += 1
    return made_of, wrong


if __name__ == "__main__":
    made_of, wrong = malformed(int(sys.argv[1]), int(sys.argv[2]))
    print(
        f"{sum(made_of.values())} files of {len(made_of)} kinds, {sum(wrong.values())} ended otherwise than they must"
    )
    for what, times in wrong.most_common():
        print(f"{times} {what}")
    sys.exit(bool(wrong))
