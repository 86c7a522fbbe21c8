"""The paper beside the platform: every equation, table and figure with the measured difference."""

from studies.paper.equations import equation_residuals
from studies.paper.numbers import collect
from studies.paper.page import page

__all__ = ["collect", "equation_residuals", "page"]
