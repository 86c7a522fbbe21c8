"""The one error that bad input raises."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input, said in one line: what was received, where, what was expected, what to do.

    Parameters
    ----------
    where : str
        The place of the fault: a file, a column, a grain, a contact, an argument.
    received : str
        What stood there.
    expected : str
        What should have stood there.
    remedy : str
        What the user can do about it.

    Examples
    --------
    >>> from loops import InputError
    >>> str(InputError("radius of grain 3", "-0.1", "a positive length", "Correct the file."))
    'radius of grain 3: got -0.1, expected a positive length. Correct the file.'
    """

    def __init__(self, where: str, received: str, expected: str, remedy: str) -> None:
        message = f"{where}: got {received}, expected {expected}. {remedy}"
        super().__init__(" ".join(message.split()))
        self.where = where
        self.received = received
        self.expected = expected
        self.remedy = remedy
