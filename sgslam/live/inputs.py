"""What a live run is given beside its scans."""

from argparse import Namespace
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from sgslam.cli.job.scan_inputs import PassedScans, ScanInputs
from sgslam.cli.processes.messages import MapInputs, Pose2
from sgslam.config import Config
from sgslam.live.warm_up import warm_up


@dataclass(frozen=True)
class LiveInputs:
    """The names are those of the options of `sgslam run`."""

    out: Path
    config: Config
    bim: Path | None = None
    layers: tuple[str, ...] = ()
    map: Path | None = None
    storey: str | None = None
    start: Pose2 | None = None
    ground_truth: Path | None = None
    verbose: bool = False

    def for_map(self) -> MapInputs:
        """What the process that maps is given."""
        scans = ScanInputs(None, self.config, PassedScans(self.out))
        return MapInputs(self._options(), scans, partial(warm_up, self.config, with_map=True), outlives=True)

    def _options(self) -> Namespace:
        """As options of a run."""
        from sgslam.run import default_options

        options = default_options()
        options.out, options.bim, options.layer, options.map = self.out, self.bim, list(self.layers), self.map
        options.single_pass = True  # no one waits for another
        options.storey, options.ground_truth, options.verbose = self.storey, self.ground_truth, self.verbose
        options.start = None if self.start is None else ",".join(map(repr, self.start))
        return options
