"""The state of a long run on disk, from which the run goes on after it was killed, to the same bits.

The file lies in the user's cache folder, named by a digest of the case: all arrays that the steps so far have changed,
and what their bits depend on, as `numpy.savez` writes them. Nothing in it is executed.
"""

from __future__ import annotations

import contextlib
import json
import time
import zipfile
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from percuss.cache import cache_folder
from percuss.case.case import Case
from percuss.digest import content_digest
from percuss.errors import InputError, UnwrittenError, wrong_input
from percuss.files import replacing
from percuss.jsonable import Entries, as_lists
from percuss.methods.interfaces import Array
from percuss.results.differences import changes
from percuss.results.provenance import components_used, machine, origins

SUFFIX = ".state"
SAVE_SECONDS = 60.0  # between two saved states
MOST_OF_TIME = 0.05  # share of the time of a run that saving may take
FORGOTTEN_AFTER = 30 * 86400.0  # seconds after which the state of a run that nobody has gone on with is removed
PLACE = "--resume"
ANEW = "Run the case without --resume: it begins anew."
DAMAGED = (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile)


class SavedState:
    """The saved state of a run, an implementation of `percuss.march.march.Keeper`.

    Parameters
    ----------
    case
        The case of the run.
    compiled
        Whether the time loop may be compiled.
    resume
        Whether the run goes on from the state that an earlier one has saved.

    Attributes
    ----------
    done, seconds
        Steps of the saved state from which the run goes on, and the time that they took; 0 for a run that begins anew.

    Raises
    ------
    InputError
        If the run is to go on, and there is no saved state, it is damaged, or what its bits depend on has changed.
    """

    def __init__(self, case: Case, *, compiled: bool, resume: bool) -> None:
        self._case, self._compiled = case, compiled
        self.done, self.seconds = 0, 0.0
        self._due = time.monotonic() + SAVE_SECONDS
        if resume:
            with contextlib.ExitStack() as files:
                self._saved = self._opened(files)
                header = self._expect_same_bits()
                self.done, self.seconds = header["done"], header["seconds"]
                self._files = files.pop_all()

    @cached_property
    def path(self) -> Path | None:
        """Path of the file; None if there is no cache folder."""
        folder, case = cache_folder(), self._case
        identity = [as_lists(case.data), dict(case.data_files), self._compiled]
        name = content_digest(json.dumps(identity, sort_keys=True, default=str).encode()) + SUFFIX
        return None if folder is None else folder / name

    def offer(self, done: int, seconds: float, arrays: Sequence[Array], *, at_once: bool) -> None:
        """Save the arrays as they are after `done` steps, if it is time or `at_once`; a full disk keeps none."""
        began = time.monotonic()
        if (began < self._due and not at_once) or self.path is None:
            return
        header = json.dumps({"done": done, "seconds": seconds, **self._made_with()})
        with (
            contextlib.suppress(OSError, InputError, UnwrittenError),
            replacing(self.path, SUFFIX) as temporary,
            temporary.open("wb") as file,
        ):
            np.savez(file, *arrays, header=np.array(header))
        now = time.monotonic()
        self._due = now + max(SAVE_SECONDS, (now - began) / MOST_OF_TIME)

    def restore(self, arrays: Sequence[Array]) -> None:
        """Fill the arrays with what was saved of them.

        Another run of the case may have replaced the file meanwhile: it is open since the run began.
        """
        with self._files:
            for k, array in enumerate(arrays):
                saved = self._read(f"arr_{k}")
                if (saved.shape, saved.dtype) != (array.shape, array.dtype):
                    raise self._damaged()
                array[...] = saved

    def forget(self) -> None:
        """Remove the state of a run that has ended, and states that nobody has gone on with for long."""
        if "path" not in vars(self) or self.path is None:  # nothing was saved or restored
            return
        with contextlib.suppress(OSError):
            self.path.unlink(missing_ok=True)
            for file in self.path.parent.glob(f"*{SUFFIX}"):
                if file.stat().st_mtime < time.time() - FORGOTTEN_AFTER:
                    file.unlink()

    def _made_with(self) -> Entries:
        return {**machine(), **origins(self._case, components_used(self._case))}

    def _opened(self, files: contextlib.ExitStack) -> Any:
        """Return what the file holds, read when it is asked for; `files` closes it."""
        if self.path is None or not self.path.is_file():
            message = "expected the saved state of a run of this case, found none"
            when = f"A run saves its state after {SAVE_SECONDS:.0f} s, for its case with all values of --set."
            raise wrong_input(PLACE, message, f"{when} {ANEW}")
        try:
            return files.enter_context(np.load(files.enter_context(self.path.open("rb"))))
        except DAMAGED as error:
            raise self._damaged() from error

    def _read(self, name: str) -> Any:
        try:
            return self._saved[name]  # compares the checksum of the array
        except DAMAGED as error:
            raise self._damaged() from error

    def _damaged(self) -> InputError:
        return wrong_input(PLACE, f"the saved state {self.path} is damaged", ANEW)

    def _expect_same_bits(self) -> Entries:
        """Return the header of the file, once all that bits depend on has proved the same."""
        header: Entries = json.loads(str(self._read("header")))
        # Another kernel of the system changes no bit: the machine may have been started anew.
        changed = [change for change in changes(header, self._made_with()) if change.what != "system"]
        if changed:
            found = "; ".join(f"{change.what} was {change.then}, is {change.now}" for change in changed)
            message = f"expected all on which bits depend as it was when the state was saved, found changes: {found}"
            raise wrong_input(PLACE, message, ANEW)
        return header
