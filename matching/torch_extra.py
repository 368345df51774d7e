"""PyTorch is an extra: only training and the published networks need it."""

from importlib.util import find_spec

from data.common.errors import UserError


def has_torch() -> bool:
    """Whether PyTorch is installed."""
    return find_spec("torch") is not None


def need_torch(what: str) -> None:
    """Raises UserError if PyTorch, which `what` needs, is not installed."""
    if not has_torch():
        raise UserError(f"{what} needs PyTorch; pip install 'sgslam[torch]'")
