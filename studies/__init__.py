"""Studies of snapshots, series, loops and packings: tables, figures and the command line."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("grainloops")
except PackageNotFoundError:
    __version__ = "not installed"
