"""How far a refit is, for whoever waits for it. It is said through the context: no result depends on who listens."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

Hearer = Callable[[int, int], None]
"""Called with the rounds that are done and how many there are at most."""
_HEARER: ContextVar[Hearer | None] = ContextVar("hearer", default=None)


@contextmanager
def heard(by: Hearer) -> Iterator[None]:
    """Within the block every refit says how far it is.

    Examples
    --------
    >>> with heard(lambda done, most: print(f"{done} of {most}")):
    ...     for _ in rounds(2):
    ...         pass
    0 of 2
    1 of 2
    """
    token = _HEARER.set(by)
    try:
        yield
    finally:
        _HEARER.reset(token)


def rounds(most: int) -> Iterator[int]:
    """``range(most)``, heard by who listens."""
    hearer = _HEARER.get()
    for k in range(most):
        if hearer is not None:
            hearer(k, most)
        yield k
