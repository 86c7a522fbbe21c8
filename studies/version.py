"""The version of the platform."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("grainloops")
except PackageNotFoundError:
    __version__ = "not installed"
