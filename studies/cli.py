"""The command line: `grainloops`."""

from __future__ import annotations

import gc
import io
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import nullcontext, suppress
from types import FrameType
from typing import Annotated, NoReturn

from cyclopts import App, CycloptsError, MissingArgumentError, Parameter

from loops.errors import InputError, out_of_memory
from studies import environment
from studies.commands import Answer
from studies.commands.loops import (
    bench_command,
    diamond_command,
    domain_command,
    loop_command,
    polygon_command,
)
from studies.commands.packing import (
    evolve_command,
    forecast_command,
    material_command,
    probe_command,
    sustain_command,
)
from studies.commands.snapshot import check_command, series_command, snapshot_command
from studies.questions import FURTHER

HELP = (
    "Stability of grain loops in two-dimensional granular media. Angles in degrees; forces, "
    "stresses and strains positive in compression."
)
# No error is longer than a screen: the middle of what was received is left out.
LONGEST_MESSAGE = 1000
# Bytes below which linear algebra asks for its buffers again and again while it is loaded.
ADDRESS_SPACE = 800_000_000
INTERRUPTED = 130
GC_THRESHOLD = 100_000  # new objects between two collections; Python's own 700


app = App(
    name="grainloops",
    help=HELP,
    version_flags=(),
    help_format="markdown",
    # The help shows no default of flags and of empty words.
    default_parameter=Parameter(
        negative=(),
        allow_repeating=True,
        show_default=lambda value: None if isinstance(value, bool) or value == "" else value,
    ),
    result_action="return_value",
    suppress_keyboard_interrupt=False,
    exit_on_error=False,
    print_error=False,
)
COMMANDS: dict[str, Callable[..., Answer]] = {
    command.__name__.removesuffix("_command"): command
    for command in (
        *(check_command, snapshot_command, series_command, probe_command, sustain_command),
        *(evolve_command, forecast_command, diamond_command, polygon_command, loop_command),
        *(domain_command, material_command, bench_command),
    )
}
for place, (name, command) in enumerate(COMMANDS.items()):
    app.command(command, name=name, sort_key=place)
app.register_install_completion_command()
app.meta.suppress_keyboard_interrupt = False


@app.command(name="--show-completion")
def show_completion() -> None:
    """Print the shell's completion script."""
    print(app.meta.generate_completion())


@app.meta.default
def launch(
    *words: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    version: Annotated[bool, Parameter(group=FURTHER)] = False,
    quiet: Annotated[bool, Parameter(group=FURTHER)] = False,
    figure_width: Annotated[str | None, Parameter(group=FURTHER, metavar="COLUMNS")] = None,
) -> Answer | None:
    """Take the options that every command has, and run the command.

    Parameters
    ----------
    version
        Print the version of grainloops, and exit.
    quiet
        Print only errors, and the summary with --json.
    figure_width
        Figure width: single (86 mm), double (178 mm).
    """
    if version:
        from studies import __version__

        print(f"grainloops {__version__}")
        return None
    if figure_width is not None:
        from studies.style import figure_width as set_width

        set_width(figure_width)
    # `series --in-packing` alone means its rates: the next word may be a file.
    asked = [
        "--in-packing=rates"
        if word == "--in-packing" and words[0] == "series" and after not in ("rates", "events")
        else word
        for word, after in zip(words, [*words[1:], ""], strict=False)
    ]
    # Progress bars and the clock read this variable, in worker processes too.
    with environment(TTY_COMPATIBLE="0") if quiet else nullcontext():
        answer: Answer | None = app(asked)
    if answer is not None:
        _print(answer, quiet)
    return answer


def _print(answer: Answer, quiet: bool) -> None:
    """Print an answer; its results have been written, so a closed output loses nothing."""
    text = answer.json
    if text is None and not quiet:
        text = "\n".join(answer.lines)
    try:
        if text:
            print(text, flush=True)
    except OSError as error:
        _forget_output()
        if not isinstance(error, BrokenPipeError):
            _fail(f"{error.strerror}; the results are in {answer.out}", status=1)
    for message in answer.errors:
        _print_error(message)


def main() -> None:
    """Run the command; bad input gives one line on stderr and exit status 2."""
    # Arrays are short-lived: clearing huge pages for them takes longer than it saves.
    os.environ.setdefault("NUMPY_MADVISE_HUGEPAGE", "0")
    # The cores have threads of their own; those of linear algebra would change last digits.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Arrow's own pool keeps tables that were read and dropped: a tenth of the peak.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    # Libraries make objects that stay: collections while they load find nothing, for .15 s.
    gc.set_threshold(GC_THRESHOLD)
    if not sys.warnoptions:
        # Warnings are for developers; the notes of a summary tell users what they should know.
        warnings.simplefilter("ignore")
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    if sys.platform != "win32":
        import resource

        # With less, libraries would wait for memory without end, or abort.
        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY and limit < ADDRESS_SPACE:
            least = f"at least {ADDRESS_SPACE / 1e9:g} GB, see ulimit -v"
            _fail(f"out of memory: {limit / 1e9:.2g} GB of address space; {least}.", status=1)
    # Compiled code of libraries may turn the exception of a Ctrl-C into another one.
    interrupted = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        interrupted.set()
        signal.default_int_handler(number, frame)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, note)
    try:
        answer = app.meta(sys.argv[1:])
    except KeyboardInterrupt as error:
        _fail(f"interrupted; {str(error) or 'nothing was written'}.", status=INTERRUPTED)
    except Exception as error:
        if interrupted.is_set():
            _fail("interrupted.", status=INTERRUPTED)
        _report(error)
    # At its end Python would look twice at each object of the libraries, for .2 s.
    gc.freeze()
    sys.exit(answer.status if isinstance(answer, Answer) else 0)


def _report(error: Exception) -> NoReturn:
    """End with the line that explains an error; one that nobody expects keeps its traceback."""
    said = str(error)
    match error:
        case InputError():
            _fail(said)
        case MissingArgumentError():
            name = "" if error.argument is None else error.argument.name
            kind = "option" if name.startswith("-") else "argument"
            _fail(f"Missing {kind} '{name}'. {_help_of(error)}")
        case CycloptsError():
            _fail(f"{said if said.endswith(('.', '?')) else f'{said}.'} {_help_of(error)}")
        case OSError():
            _forget_output()
            _fail(said, status=1)
        case MemoryError() | RuntimeError() | ImportError() if out_of_memory(error):
            said = said if said.startswith("out of memory") else f"out of memory. {said}"
            _fail(said.rstrip(". "), status=1)
    raise error


def _help_of(error: CycloptsError) -> str:
    """Return the sentence that names the help of the command with the error."""
    return f"Try '{' '.join(['grainloops', *(error.command_chain or ())])} --help'."


def _fail(message: str, status: int = 2) -> NoReturn:
    _print_error(message)
    sys.exit(status)


def _print_error(message: str) -> None:
    """Print an error on one line of stderr."""
    line = " ".join(message.split())
    if len(line) > LONGEST_MESSAGE:
        line = f"{line[: LONGEST_MESSAGE // 2]} ... {line[-LONGEST_MESSAGE // 2 :]}"
    print(f"grainloops: {line}", file=sys.stderr)


def _forget_output() -> None:
    """Drop output that could not be printed, so that the exit does not try again."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    main()
