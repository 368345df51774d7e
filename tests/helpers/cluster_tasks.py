"""Work for a cluster whose workers are to be tried."""

import time


def slowly_doubled(n: int) -> int:
    time.sleep(0.05)
    return 2 * n
