"""Warnings with the place of the caller outside this package."""

import warnings
from collections.abc import Iterable


def warn_all(sentences: Iterable[str]) -> None:
    """Give each of `sentences` as a UserWarning of the code that called this package."""
    for sentence in sentences:
        # 1 is here, 2 the function of this package, 3 its caller.
        warnings.warn(sentence, UserWarning, stacklevel=3)
