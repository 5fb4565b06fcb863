"""Between pipeline and screen: a thread, and a mailbox that drops snapshots, never data.

The pipeline never waits for the screen: it puts its newest picture where the last one was. The screen never waits for
the pipeline: it takes the picture if there is one. Commands go the other way, through a queue of their own.
"""

import queue
import threading
from collections import deque
from collections.abc import Callable, Iterator

from gcs_health.dashboard.commands import Command
from gcs_health.dashboard.snapshot import Snapshot

PICTURE_US = 100_000  # µs between pictures


class Worker:
    """Runs `job(worker)` in a thread until it ends or `stop` is called.

    Attributes
    ----------
    error : what the job raised; None. done : it has ended.
    dropped : pictures that were never looked at.
    """

    def __init__(self, job: "Callable[[Worker], None]") -> None:
        self.error: BaseException | None = None
        self.done = False
        self.dropped = 0
        self._job = job
        self._newest: deque[Snapshot] = deque(maxlen=1)
        self._commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="pipeline", daemon=True)

    # -- the screen's side --------------------------------------------------------------------------

    def start(self) -> None:
        """Let the job begin."""
        self._thread.start()

    def take(self) -> Snapshot | None:
        """Return the newest picture, once."""
        try:
            return self._newest.pop()
        except IndexError:
            return None

    def send(self, command: Command) -> None:
        """Ask the pipeline for something."""
        self._commands.put(command)

    def stop(self) -> None:
        """Ask the job to end, and wait until it has."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    # -- the job's side -----------------------------------------------------------------------------

    @property
    def stopping(self) -> bool:
        """Whether the job must come to its end."""
        return self._stop.is_set()

    def rest(self, seconds: float) -> None:
        """Wait, but not longer than until the job must end."""
        self._stop.wait(seconds)

    def publish(self, snapshot: Snapshot) -> None:
        """Show a picture; one that nobody took yet is dropped."""
        self.dropped += len(self._newest)
        self._newest.append(snapshot)

    def commands(self) -> Iterator[Command]:
        """Yield what the screen asked for since."""
        while True:
            try:
                yield self._commands.get_nowait()
            except queue.Empty:
                return

    def _run(self) -> None:
        try:
            self._job(self)
        except BaseException as error:
            self.error = error
        finally:
            self.done = True
