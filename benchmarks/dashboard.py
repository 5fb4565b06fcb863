"""What the dashboard costs: CPU of a picture, share of a core at ten a second, time to the first one.

    python benchmarks/dashboard.py --seconds 10 --runs 5

*Screen*: the real app in a pseudo-terminal is given pictures in which every number of every rotor changes, ten a
second; all its CPU is counted, Textual's and the terminal driver's too. *Session*: `gcs-health demo` of an octocopter
as an operator sees it, pipeline and all, while it flies; CPU of its process alone. *First picture*: from the command
to the first bytes that name the screen, warm files. The terminal at the other end is a reader that throws bytes away.
"""

import argparse
import os
import pty
import resource
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable
from dataclasses import replace
from fcntl import ioctl
from pathlib import Path

SIZES = ((80, 24), (160, 50))
TESTS = Path(__file__).parents[1] / "tests" / "dashboard"


class Pictures:
    """A pipeline that has a new picture at every look."""

    def __init__(self, seconds: float) -> None:
        sys.path.insert(0, str(TESTS))
        import pictures

        self.done = False
        self.error: BaseException | None = None
        self._base = pictures.failing("octa")
        minute = self._base.vehicles[0].rows
        self._rows = minute + tuple(row._replace(t=row.t + 62.0 * n) for n in (1, 2) for row in minute)
        self._seconds = seconds
        self.count = 0
        self.began = 0.0
        self.cpu = 0.0

    def start(self) -> None:
        """See `app.Pipeline`."""

    def send(self, command: object) -> None:
        """See `app.Pipeline`."""

    def take(self) -> object:
        """Return the base with every number moved a little."""
        if self.count == 10:  # Textual has settled
            self.began, self.cpu = time.monotonic(), time.process_time()
        self.count += 1
        k = self.count
        craft = self._base.vehicles[0]
        rotors = tuple(
            replace(
                rotor,
                speed=rotor.speed + 3.0 * (k % 17) + rotor.motor,
                current=rotor.current + 0.1 * (k % 7),
                trail=(*rotor.trail[k % 60 :], *rotor.trail[: k % 60]),
                figures=tuple(replace(f, value=f.value + 0.01 * (k % 5)) for f in rotor.figures),
            )
            for rotor in craft.rotors
        )
        craft = replace(craft, rotors=rotors, rows=self._rows[k : k + 620], t=craft.t + 0.1 * k)
        self.made = time.process_time()
        if self.count > 10 and time.monotonic() - self.began > self._seconds:
            self.done = True
        return replace(self._base, us=self._base.us + 100_000 * k, vehicles=(craft,))


def child(seconds: float, out: int) -> None:
    """Run the app on this terminal, write (pictures, CPU s, CPU s of making the pictures, s) to `out`."""
    from gcs_health.dashboard.app import Dashboard

    pipeline = Pictures(seconds)
    making = [0.0]
    take = pipeline.take

    def timed() -> object:
        before = time.process_time()
        shown = take()
        if pipeline.count > 10:
            making[0] += time.process_time() - before
        return shown

    pipeline.take = timed  # type: ignore[method-assign]
    Dashboard(pipeline, leaves=lambda: True).run()  # type: ignore[arg-type]
    cpu, wall = time.process_time() - pipeline.cpu, time.monotonic() - pipeline.began
    os.write(out, f"{pipeline.count - 10} {cpu} {making[0]} {wall}".encode())


def on_terminal(
    command: list[str],
    size: tuple[int, int],
    seen: Callable[[bytes, float], bool],
    keep: tuple[int, ...] = (),
) -> resource.struct_rusage:
    """Run a command on a pseudo-terminal, throw away what it draws until `seen` says stop; return its usage."""
    master, slave = pty.openpty()
    ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color", "COLORTERM": "truecolor"}
    began = time.monotonic()
    process = subprocess.Popen(
        command,
        stdin=slave,
        stdout=slave,
        stderr=slave,
        env=environment,
        pass_fds=keep,
        start_new_session=True,
    )
    os.close(slave)
    asked = False
    while True:
        if select.select([master], [], [], 0.05)[0]:
            try:
                data = os.read(master, 1 << 16)
            except OSError:
                break
            if not asked and seen(data, time.monotonic() - began):
                asked = True
                os.write(master, b"qy")  # an armed vehicle: it asks
        elif not asked and seen(b"", time.monotonic() - began):
            asked = True
            os.write(master, b"qy")  # an armed vehicle: it asks
    _, _, usage = os.wait4(process.pid, 0)
    os.close(master)
    return usage


def screen(size: tuple[int, int], seconds: float) -> tuple[float, float]:
    """Return (CPU of a picture [ms], share of a core)."""
    reader, writer = os.pipe()
    command = [sys.executable, __file__, "--child", str(writer), "--seconds", str(seconds)]
    on_terminal(command, size, lambda data, t: False, (writer,))
    count, cpu, making, wall = map(float, os.read(reader, 200).split())
    return 1e3 * (cpu - making) / count, (cpu - making) / wall


def child_cpu() -> float:
    """Return the CPU of the newest child [s], to a hundredth."""
    children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()
    fields = Path(f"/proc/{children[-1]}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def session(seconds: float) -> float:
    """Return the share of a core that a live session of an octocopter takes, pipeline and screen."""
    command = [sys.executable, "-m", "gcs_health", "demo", "motor_stops"]
    used: list[tuple[float, float]] = []

    def seen(data: bytes, t: float) -> bool:
        if t > 3.0:
            used.append((t, child_cpu()))
        return t > 3.0 + seconds

    on_terminal(command, SIZES[0], seen)
    (t0, cpu0), (t1, cpu1) = used[0], used[-1]
    return (cpu1 - cpu0) / (t1 - t0)


def first_picture() -> tuple[float, float]:
    """Return the time from the command to the first picture, and the CPU spent until then [s]."""
    found: list[tuple[float, float]] = []

    def seen(data: bytes, t: float) -> bool:
        if b"starting" in data and not found:
            found.append((t, child_cpu()))
        return bool(found)

    command = [sys.executable, "-m", "gcs_health", "live", "udpin://127.0.0.1:0", "--history", "none"]
    on_terminal(command, SIZES[0], seen)
    return found[0]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--child", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child is not None:
        child(args.seconds, args.child)
        return
    print("| what | measured | aim |\n|---|---|---|")
    for size in SIZES:
        cost, share = screen(size, args.seconds)
        print(f"| CPU of a picture, 8 rotors, {size[0]}x{size[1]} | {cost:.1f} ms | 12 ms |", flush=True)
        print(f"| share of a core at 10 Hz, {size[0]}x{size[1]} | {100 * share:.1f} % | 15 % |", flush=True)
    print(
        f"| live octocopter, pipeline and screen | {100 * session(args.seconds):.0f} % of a core | |",
        flush=True,
    )
    wall, cpu = sorted(first_picture() for _ in range(args.runs))[args.runs // 2]
    print(f"| command to first picture, median of {args.runs} | {wall:.2f} s, CPU {cpu:.2f} s | 1.0 s |")


if __name__ == "__main__":
    main()
