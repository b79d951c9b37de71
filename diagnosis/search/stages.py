"""The steps of a diagnosis as it tells them, which of them are still to come, and how long they usually take."""

from collections.abc import Mapping

CHECKING = "checking the data"
REFITTING = "refitting the stated parameters"
TESTING = "testing"
"""How the text begins that tells how many effects are tested."""
COMPARING = "refitting with the likeliest effects"
EXCHANGING = "exchanging each effect for every other"
LEFT = "testing what is left"
ELSEWHERE = "asking each effect on other records"
SPECTRA = "comparing spectra"
LOCATING = "looking where the mismatch is"

USUAL: Mapping[str, float] = {
    CHECKING: 0.0, REFITTING: 1.0, LEFT: 0.3, SPECTRA: 1.0, LOCATING: 0.15, COMPARING: 2.0, EXCHANGING: 4.0,
    TESTING: 0.5, ELSEWHERE: 1.0,
}  # fmt: skip
"""Step -> its usual time over that of the refit of the stated parameters, on two minutes of a drive, a hole and a
circuit. Texts are looked up by how they begin, in this order. The time of checking is that of reading and is not
compared."""
_END = (LEFT, LOCATING)
AFTER: Mapping[str, tuple[str, ...]] = {
    CHECKING: (REFITTING, TESTING, COMPARING, *_END), REFITTING: (TESTING, COMPARING, *_END),
    TESTING: (COMPARING, *_END), COMPARING: _END, EXCHANGING: _END, LEFT: (LOCATING,), ELSEWHERE: (LOCATING,),
    SPECTRA: (LOCATING,), LOCATING: (),
}  # fmt: skip
"""Step -> those that come after it in any case: what was found may ask for more."""


def step_of(text: str) -> str | None:
    """The step that a text tells; None for a remark."""
    return next((step for step in USUAL if text.startswith(step)), None)


def testing(count: int) -> str:
    """What is told when so many effects are tested."""
    return f"{TESTING} {count} effects"
