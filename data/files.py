"""Files are written whole or not at all."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any


def write_atomically(path: Path | str, content: str | bytes) -> None:
    """Writes `content` beside `path` and renames it into place, so that a reader never sees half a file."""
    path = Path(path)
    raw = content.encode() if isinstance(content, str) else content
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(raw)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def write_json(path: Path | str, value: Any) -> None:
    """Writes strict JSON (no NaN) atomically."""
    write_atomically(path, json.dumps(value, indent=1, allow_nan=False) + "\n")
