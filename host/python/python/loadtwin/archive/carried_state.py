"""What is carried from day to day: state of the estimator, counts of load cycles."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
from pathlib import Path

from .complete_file import write_complete

#: Name of the file beside the estimates of a day; engines pass over names with this first letter.
NAME = "_state"


@dataclasses.dataclass(frozen=True)
class CarriedState:
    """State at the end of a day.

    Attributes
    ----------
    state : bytes or None
        State of the estimator.
    end_s : float or None
        Time of the last sample [s].
    description_sha256 : str
        Hash of the description that it belongs to.
    counts : dict of str to bytes
        Counts of load cycles by load, since the first day.
    """

    state: bytes | None = None
    end_s: float | None = None
    description_sha256: str = ""
    counts: dict[str, bytes] = dataclasses.field(default_factory=dict)

    def to_bytes(self) -> bytes:
        """Give it as bytes."""
        encode = lambda content: base64.b64encode(content).decode()
        content = {
            "loadtwin": "state of a day",
            "format": 1,
            "end_s": self.end_s,
            "description_sha256": self.description_sha256,
            "state": None if self.state is None else encode(self.state),
            "counts": {name: encode(counts) for name, counts in self.counts.items()},
        }
        return json.dumps(content).encode() + b"\n"

    @property
    def sha256(self) -> str:
        """Hash of the bytes."""
        return hashlib.sha256(self.to_bytes()).hexdigest()

    def write(self, folder: Path) -> None:
        """Write it beside the estimates of its day."""
        write_complete(folder / NAME, self.to_bytes())


def read(folder: Path, sha256: str) -> CarriedState | None:
    """Read the state of a day; none where there is none with this hash."""
    try:
        content = (folder / NAME).read_bytes()
    except OSError:
        return None
    if hashlib.sha256(content).hexdigest() != sha256:
        return None
    found = json.loads(content)
    decode = base64.b64decode
    return CarriedState(
        state=None if found["state"] is None else decode(found["state"]),
        end_s=found["end_s"],
        description_sha256=found["description_sha256"],
        counts={name: decode(counts) for name, counts in found["counts"].items()},
    )
