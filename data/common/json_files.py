"""Reads users' JSON files; all errors are one line."""

import json
from pathlib import Path
from typing import Any

from data.common.errors import UserError


def read_json(path: Path | str, wanted: str) -> Any:
    """Returns the file's value. Raises UserError if it cannot be read or is not JSON; `wanted` says what to give
    instead.
    """
    try:
        return json.loads(Path(path).read_bytes())
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give {wanted}") from None
    except (ValueError, RecursionError):  # ValueError covers bad encodings and numbers of thousands of digits
        raise UserError(f"{path}: not JSON; give {wanted}") from None
