"""`python -m sgslam` is the command `sgslam`."""

from sgslam.cli.command import main

if __name__ == "__main__":  # processes that a command starts import this file too
    main()
