"""Our packages have common names. This detects another package that Python finds in place of one of ours."""

from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def foreign_package(name: str) -> str | None:
    """One line for the user where `name` is not our own package; None where it is. The package is not loaded."""
    try:
        spec = find_spec(name)
    except ValueError:  # a module without a spec stands in sys.modules
        spec = None
    found = Path(spec.origin).resolve() if spec is not None and spec.origin else None
    if found == ROOT / name / "__init__.py":
        return None
    other = "none" if found is None else f"another, {found}"
    return (
        f"sgslam needs its own package '{name}' from {ROOT}, but Python finds {other}; "
        "run in an environment or folder without it"
    )
