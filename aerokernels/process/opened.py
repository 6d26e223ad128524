"""What this process holds open from one call to the next: the only object of the package that outlives them all.

Opening a device, building a kernel and starting a child process each take much longer than using them, so they are
done once a process. Whatever belongs to a field, a result or a prepared object is held by that object, not here.
"""

import threading
from collections.abc import Callable, Hashable
from typing import Any


class Opened:
    """Things that are opened once, by key, until they are taken out or the process ends; thread-safe.

    A forked child inherits them: keys of what does not survive a fork hold the process's id.
    """

    def __init__(self) -> None:
        """Nothing is open."""
        self.lock = threading.RLock()
        self._held: dict[Hashable, Any] = {}

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What `make` gave for this key when it was first asked for."""
        with self.lock:
            if key not in self._held:
                self._held[key] = make()
            return self._held[key]

    def held(self, kind: str) -> dict[tuple, Any]:
        """All that is open under keys that are tuples beginning with `kind`, by key."""
        with self.lock:
            return {key: thing for key, thing in self._held.items() if isinstance(key, tuple) and key[0] == kind}

    def take_out(self, key: Hashable) -> Any:
        """What was held under a key, and is not any more; None where there was nothing."""
        with self.lock:
            return self._held.pop(key, None)


OPENED = Opened()
