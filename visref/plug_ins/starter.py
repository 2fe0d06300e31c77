"""Starts a program of somebody else's and outlives it, so that nothing it started outlives the run.

Run as a file, by a Python that imports nothing else: `starter.py REPORT BYTES PROGRAM ARGUMENT…`.
It writes how the program ended to the file descriptor REPORT, `S` and the status or `E` and the
error number with which it did not start, and waits. Told to end (SIGTERM), which it is when its
parent ends too, it first ends all that the program started, daemons included where the system is
Linux. BYTES, 0 for none, limits the memory of each process and the size of each file it writes.
"""

import ctypes
import os
import resource
import signal
import sys
from contextlib import suppress

# Rounds of killing: who forks faster than it is killed gets away in no fewer.
_ROUNDS = 100


def main(report: int, limit: int, words: list[str]) -> None:
    """Run the program `words`."""
    signal.signal(signal.SIGTERM, _end)
    _die_with_the_parent(signal.SIGTERM)
    _adopt()
    os.set_inheritable(report, False)
    child = os.fork()
    if child == 0:
        _become(words, report, limit)
    ended = 0
    while ended != child:
        ended, status = os.waitpid(-1, 0)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    os.write(report, f"S{os.waitstatus_to_exitcode(status)}\n".encode())
    while True:
        signal.pause()


def _become(words: list[str], report: int, limit: int) -> None:
    _die_with_the_parent(signal.SIGKILL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if limit:
        for what in (resource.RLIMIT_DATA, resource.RLIMIT_FSIZE):
            resource.setrlimit(what, (limit, limit))
    # Python ignores these, and a program inherits that.
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execv(words[0], words)
    except OSError as error:
        os.write(report, f"E{error.errno}\n".encode())
    os._exit(127)


def _end(*_: object) -> None:
    """End all that is below, then this."""
    for _round in range(_ROUNDS):
        below = _below(os.getpid())
        if not below:
            break
        for process in below:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGKILL)
        with suppress(ChildProcessError):
            # A killed child is waited for; its children come to this process.
            os.waitpid(-1, 0)
    os._exit(0)


def _below(root: int) -> list[int]:
    """The processes that descend from one, but for those that have ended; none where the system
    does not tell."""
    parents: dict[int, int] = {}
    with suppress(OSError):
        for name in os.listdir("/proc"):
            with suppress(OSError, ValueError, IndexError):
                process = int(name)
                with open(f"/proc/{name}/stat", "rb") as file:
                    # After the program's name, which may hold anything: state and parent.
                    state, parent = file.read().rpartition(b")")[2].split()[:2]
                if state not in (b"Z", b"X"):
                    parents[process] = int(parent)
    found, frontier = [], [root]
    while frontier:
        above = set(frontier)
        frontier = [process for process, parent in parents.items() if parent in above]
        found += frontier
    return found


def _prctl(option: int, value: int) -> None:
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def _die_with_the_parent(number: int) -> None:
    PR_SET_PDEATHSIG = 1
    parent = os.getppid()
    _prctl(PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


def _adopt() -> None:
    """Become the parent of whatever below loses its own."""
    PR_SET_CHILD_SUBREAPER = 36
    _prctl(PR_SET_CHILD_SUBREAPER, 1)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:])
