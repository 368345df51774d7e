"""Work for a cluster whose workers are to be tried."""

import os
import signal


def doubled(n: int) -> int:
    return 2 * n


def deadly(n: int) -> int:
    """Three ends whatever process it is worked on in, and minus three raises."""
    if n == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    if n == -3:
        raise ValueError("minus three\nis too few")
    return 2 * n
