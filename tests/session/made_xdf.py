"""XDF files by the format's own description (chunks of a length, a tag and a content), not by the reader's library."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

CLOCK = 1000.0
"""[s] of the first stamp."""


def chunk(tag: int, content: bytes) -> bytes:
    """A chunk with a length of four bytes."""
    return b"\x04" + struct.pack("<IH", len(content) + 2, tag) + content


def stream_header(number: int, name: str, labels: Sequence[str], unit: str, rate: float) -> bytes:
    channels = "".join(f"<channel><label>{label}</label><unit>{unit}</unit></channel>" for label in labels)
    text = (
        f"<?xml version='1.0'?><info><name>{name}</name><type>MoCap</type><channel_count>{len(labels)}</channel_count>"
        f"<nominal_srate>{rate}</nominal_srate><channel_format>double64</channel_format><source_id>s{number}</source_id>"
        f"<created_at>0</created_at><desc><channels>{channels}</channels></desc></info>"
    )
    return chunk(2, struct.pack("<I", number) + text.encode())


def samples(number: int, time: Sequence[float], values: np.ndarray) -> bytes:
    body = struct.pack("<I", number) + b"\x04" + struct.pack("<I", len(time))
    for stamp, row in zip(time, values, strict=True):
        body += b"\x08" + struct.pack("<d", CLOCK + stamp) + row.astype("<f8").tobytes()
    return chunk(3, body)


def footer(number: int, count: int) -> bytes:
    text = (
        "<?xml version='1.0'?><info><first_timestamp>0</first_timestamp><last_timestamp>0</last_timestamp>"
        f"<sample_count>{count}</sample_count></info>"
    )
    return chunk(6, struct.pack("<I", number) + text.encode())


def xdf(time: np.ndarray, points: np.ndarray, *, unit: str = "mm", rate: float = 100.0) -> bytes:
    """Two streams of channels hand_X.. [unit] and head_X.. at `time` [s]; samples in chunks of 32."""
    header = b"XDF:" + chunk(1, b"<?xml version='1.0'?><info><version>1.0</version></info>")
    labels = "XYZ"[: points.shape[1]]
    body = stream_header(1, "hand", [f"hand_{axis}" for axis in labels], unit, rate)
    body += stream_header(2, "head", [f"head_{axis}" for axis in labels], unit, rate)
    for first in range(0, len(time), 32):
        part = slice(first, first + 32)
        body += samples(1, time[part].tolist(), points[part]) + samples(2, time[part].tolist(), -points[part])
    return header + body + footer(1, len(time)) + footer(2, len(time))
