"""The gallery: every script of `studies/examples`, run when the site is built.

A result is kept in `docs/gallery` as long as no source file changes.
"""

import ast
import hashlib
import os
import subprocess
import sys
from pathlib import Path
from shutil import copyfile

from notebooks import DOCS, cells_of_page, cells_of_script, notebook
from sphinx.errors import ExtensionError
from sphinx.util import logging

ROOT = Path(__file__).parents[2]
EXAMPLES, OUT = ROOT / "studies" / "examples", ROOT / "docs" / "gallery"
# Examples on data that are no part of the repository are not run: the figure that the pages show.
STORED = {
    "kuhn_discs": "published-kuhn-discs.png",
    "cells": "published-cells-kinetics.png",
    "quadrons": "published-cells-quadrons.png",
}
PAGE = """# {title}

{text}

![{title}]({name}/{name}.png)

```sh
python -m studies.examples.{name} RESULT_FOLDER
```

Or as a notebook: {{download}}`{name}.ipynb`.

It prints:

```{{literalinclude}} {name}/printed.txt
:language: json
:class: long
```

The script:

```{{literalinclude}} ../../studies/examples/{name}.py
:class: long
```
"""
INDEX = """# Gallery

Short studies, one question each. They were run when these pages were built; each prints its
numbers and writes its figure, and the numbers behind it, into a folder. Each page offers its
study as a notebook; [first steps](../first-steps.md) as one: {{download}}`first-steps.ipynb`.

:::{{container}} gallery
{pictures}
:::

```{{toctree}}
:hidden:

{names}
```
"""


def digest():
    """One number of all that an example may depend on."""
    found = hashlib.sha256()
    for room in ("grainloops", "loops", "patterns", "stability", "studies"):
        for path in sorted((ROOT / room).rglob("*.py")):
            found.update(path.read_bytes())
    return found.hexdigest()


def run(name, stamp):
    """Run an example unless its result is there; its printed numbers stand beside its figure."""
    folder = OUT / name
    kept = OUT / f"{name}.stamp"
    if folder.is_dir() and kept.is_file() and kept.read_text() == stamp:
        return
    if name in STORED:
        folder.mkdir(exist_ok=True)
        copyfile(DOCS / "figures" / STORED[name], folder / f"{name}.png")
        (folder / "printed.txt").write_text('{"not run here": "its data are another folder"}\n')
        return
    command = [sys.executable, "-m", f"studies.examples.{name}", str(folder)]
    # One thread of BLAS: the matrices are small.
    alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=ROOT, env=alone, capture_output=True, text=True)
    if done.returncode:
        raise ExtensionError(f"example {name}: {done.stderr}")
    (folder / "printed.txt").write_text(done.stdout)
    kept.write_text(stamp)


def build(app):
    """Run every example, write its page and the page of pictures."""
    stamp, pictures = digest(), []
    names = sorted(path.stem for path in EXAMPLES.glob("[!_]*.py"))
    OUT.mkdir(exist_ok=True)
    for name in names:
        logging.getLogger(__name__).info("example %s", name)
        run(name, stamp)
        source = (EXAMPLES / f"{name}.py").read_text()
        (OUT / f"{name}.ipynb").write_text(notebook(cells_of_script(name, source)))
        said = ast.get_docstring(ast.parse(source))
        title, _, text = said.partition("\n")
        (OUT / f"{name}.md").write_text(PAGE.format(name=name, title=title, text=text.strip()))
        pictures.append(f"[![{title}]({name}/{name}.png)\n{title}]({name}.md)\n")
    first = (DOCS / "first-steps.md").read_text()
    (OUT / "first-steps.ipynb").write_text(notebook(cells_of_page(first)))
    found = INDEX.format(pictures="\n".join(pictures), names="\n".join(names))
    (OUT / "index.md").write_text(found)


def setup(app):
    """Before any page is read."""
    app.connect("builder-inited", build)
    return {"parallel_read_safe": True}
