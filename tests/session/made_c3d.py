"""C3D files as the format has them; of a .trc by `python -m tests.session.made_c3d markers.trc lift.c3d`."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np

Array = np.ndarray


def parameter(name: str, kind: int, sizes: list[int], data: bytes, *, order: str = "<", group: int = 1) -> bytes:
    """One parameter of a group, of texts (-1), integers (2) or floats (4)."""
    body = struct.pack("bB", kind, len(sizes)) + bytes(sizes) + data + b"\0"
    return struct.pack("bb", len(name), group) + name.encode() + struct.pack(f"{order}H", len(body) + 2) + body


def c3d(
    points: Array,
    labels: list[str],
    *,
    order: str = "<",
    floats: bool = True,
    rate: float = 100.0,
    more: bytes = b"",
    group: bytes = b"TRIAL",
    count: int | None = None,
    last: int | None = None,
) -> bytes:
    """A file of points (frames, markers, 4) in mm, written as the format's description has it.

    `more` are parameters of POINT (group 1) or of another `group` (2); `last` is what the header says of frames.
    """
    width = max(map(len, labels))
    section = b"".join(
        struct.pack("bb", len(name), -number) + name + struct.pack(f"{order}H", 3) + b"\0"
        for number, name in enumerate((b"POINT", group), start=1)
    )
    text = "".join(label.ljust(width) for label in labels).encode()
    section += parameter("LABELS", -1, [width, len(labels)], text, order=order)
    section += parameter("UNITS", -1, [2], b"mm", order=order)
    section += parameter("RATE", 4, [], struct.pack(f"{order}f", rate), order=order) + more + b"\0\0"
    blocks = -(-(4 + len(section)) // 512)
    processor = 84 if order == "<" else 86
    section = (bytes([1, 0x50, blocks, processor]) + section).ljust(512 * blocks, b"\0")
    scale = -0.1 if floats else 0.1
    sizes = (count or len(labels), 0, 1, last or len(points), 0, scale, 2 + blocks, 0, rate)
    head = bytes([2, 0x50]) + struct.pack(f"{order}5HfHHf", *sizes)
    values = points.copy()
    if not floats:
        values[..., :3] = np.round(values[..., :3] / scale)
    data = values.astype(f"{order}f4" if floats else f"{order}i2").tobytes()
    return head.ljust(512, b"\0") + section + data


def of_trc(trc: Path) -> bytes:
    """The markers of OpenSim's text format as a C3D in mm, frame by frame; an empty cell is no marker."""
    lines = [line.replace(",", "\t").split("\t") for line in trc.read_text(encoding="utf-8").splitlines()]
    rate, labels = float(lines[2][0]), [cell for cell in lines[3][2:] if cell.strip()]
    assert lines[2][4] == "mm"
    rows = [cells for cells in lines[5:] if cells[0].strip()]
    points = np.zeros((len(rows), len(labels), 4))
    for frame, cells in enumerate(rows):
        for marker in range(len(labels)):
            said = cells[2 + 3 * marker : 5 + 3 * marker]
            points[frame, marker] = (*map(float, said), 0.0) if all(said) else (0.0, 0.0, 0.0, -1.0)
    return c3d(points, labels, rate=rate)


if __name__ == "__main__":
    Path(sys.argv[2]).write_bytes(of_trc(Path(sys.argv[1])))
