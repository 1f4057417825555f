"""The state of a long run on disk, from which the run goes on after it was killed, to the same bits.

The file lies in the user's cache folder and holds all arrays that the steps so far have changed, as `numpy.savez`
writes them. Its name is a digest of the case and of all that the bits of the run depend on. Nothing in it is executed.
"""

from __future__ import annotations

import contextlib
import json
import time
import zipfile
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from percuss.cache import cache_folder
from percuss.case.case import Case
from percuss.digest import content_digest, own_digest, surroundings
from percuss.errors import InputError, UnwrittenError, wrong_input
from percuss.files import replacing
from percuss.jsonable import as_lists
from percuss.methods.interfaces import Array
from percuss.results.provenance import components_used, origins, processor_model

SUFFIX = ".state"
SAVE_SECONDS = 60.0  # between two saved states
MOST_OF_TIME = 0.05  # share of the time of a run that saving may take
FORGOTTEN_AFTER = 30 * 86400.0  # seconds after which the state of a run that nobody has gone on with is removed
PLACE = "--resume"
ANEW = "Run the case without --resume: it begins anew."


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
        If the run is to go on, and there is no saved state of this case, or it is damaged.
    """

    def __init__(self, case: Case, *, compiled: bool, resume: bool) -> None:
        self._case, self._compiled = case, compiled
        self._due = time.monotonic() + SAVE_SECONDS
        self._saved = self._read() if resume else {"progress": np.zeros(2)}
        done, self.seconds = map(float, self._saved["progress"])
        self.done = int(done)

    @cached_property
    def path(self) -> Path | None:
        """Path of the file; None if there is no cache folder."""
        case, folder = self._case, cache_folder()
        plugins = {name: one["digest"] for name, one in origins(case, components_used(case))["plugins"].items()}
        made_with = [plugins, surroundings(), own_digest(), processor_model()]
        identity = [as_lists(case.data), dict(case.data_files), self._compiled, made_with]
        name = content_digest(json.dumps(identity, sort_keys=True, default=str).encode()) + SUFFIX
        return None if folder is None else folder / name

    def offer(self, done: int, seconds: float, arrays: Sequence[Array], *, at_once: bool) -> None:
        """Save the arrays as they are after `done` steps, if it is time or `at_once`; a full disk keeps none."""
        began = time.monotonic()
        if (began < self._due and not at_once) or self.path is None:
            return
        with (
            contextlib.suppress(OSError, InputError, UnwrittenError),
            replacing(self.path, SUFFIX) as temporary,
            temporary.open("wb") as file,
        ):
            np.savez(file, *arrays, progress=np.array([done, seconds]))
        now = time.monotonic()
        self._due = now + max(SAVE_SECONDS, (now - began) / MOST_OF_TIME)

    def restore(self, arrays: Sequence[Array]) -> None:
        """Fill the arrays with what was saved of them."""
        for k, array in enumerate(arrays):
            saved = self._saved.pop(f"arr_{k}", np.zeros(0))
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

    def _read(self) -> dict[str, Array]:
        """Return the arrays of the file by name."""
        if self.path is None or not self.path.is_file():
            message = "expected the saved state of a run of this case, found none"
            when = f"A run saves its state after {SAVE_SECONDS:.0f} s, for its case with all values of --set"
            raise wrong_input(PLACE, message, f"{when}, the versions and the plug-ins. {ANEW}")
        try:
            with self.path.open("rb") as file, np.load(file) as saved:  # compares the checksum of each array
                return {"progress": saved["progress"], **saved}
        except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as error:
            raise self._damaged() from error

    def _damaged(self) -> InputError:
        return wrong_input(PLACE, f"the saved state {self.path} is damaged", ANEW)
