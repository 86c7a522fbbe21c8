"""Ways to damage a file."""

from __future__ import annotations

import gzip

import numpy as np

TOKENS = (
    *(b"nan", b"inf", b"-1", b"1e400", b",", b"\n", b'"', b"0", b"9" * 20, b"\xff\xfe", b" "),
    *(b"ITEM: TIMESTEP\n", b"</DataArray>", b"<!--", b"&x;", b"-0.0", b"1e-320"),
)
GZIP = b"\x1f\x8b"


def damaged(rng: np.random.Generator, content: bytes) -> bytes:
    """A file with one kind of damage, inside its gzip envelope as often as on it.

    One to five times: bytes changed, put in, taken out, a part cut off at the end, tokens written
    over, or a stretch repeated or swapped with another.
    """
    if content.startswith(GZIP) and rng.random() < 0.7:
        return gzip.compress(_hurt(rng, gzip.decompress(content)), compresslevel=1)
    return _hurt(rng, content)


def _hurt(rng: np.random.Generator, content: bytes) -> bytes:
    kind, hurt = rng.integers(7), bytearray(content)
    for _ in range(rng.integers(1, 6)):
        place = int(rng.integers(len(hurt))) if len(hurt) else 0
        length = int(rng.integers(1, 200))
        if kind == 0 and len(hurt):
            hurt[place] = int(rng.integers(256))
        elif kind == 1:
            hurt[place:place] = rng.integers(0, 256, 3).astype(np.uint8).tobytes()
        elif kind == 2:
            del hurt[place : place + int(rng.integers(1, 20))]
        elif kind == 3:
            hurt = hurt[:place]
        elif kind == 4:
            token = TOKENS[rng.integers(len(TOKENS))]
            hurt[place : place + len(token)] = token
        elif kind == 5:
            hurt[place:place] = hurt[place : place + length]
        else:
            other = int(rng.integers(len(hurt))) if len(hurt) else 0
            hurt[other : other + length] = hurt[place : place + length]
    return bytes(hurt)
