"""Short displays of results: one line at the prompt, a small table in a notebook."""

from __future__ import annotations

from html import escape


class Shown:
    """Base of the results that hold large arrays: `facts` says what is told of them."""

    def facts(self) -> dict[str, object]:
        """Names and short values."""
        raise NotImplementedError

    def __repr__(self) -> str:
        said = ", ".join(f"{name}: {value}" for name, value in self.facts().items())
        return f"{type(self).__name__}({said})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"
