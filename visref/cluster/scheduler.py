"""The way to a Dask scheduler: one that runs already, or one of our own with workers here."""

from __future__ import annotations

import gc
import logging
import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from visref.errors import InputError

# In place of an address: a scheduler and workers that are started here, and end with the command.
LOCAL = "local"

_CONNECT_S = 10.0
_RESTART_S = 600
_GIVEN_UP = "distributed.deploy.lost-worker-timeout"
_START = "start one with `dask scheduler`, or give --dask local"


@contextmanager
def connected(address: str, workers: int | None = None) -> Iterator[Any]:
    """A `distributed.Client` of the scheduler at an address, or of one of our own with so many
    workers, of one thread each, where that is `LOCAL`.

    Raises InputError where Dask is not installed, where the address is none, and where no
    scheduler answers there.
    """
    distributed = _library()
    if address == LOCAL:
        with _local(distributed, workers or 1) as cluster, distributed.Client(cluster) as client:
            yield client
        return
    if workers is not None:
        raise InputError(
            "--workers, with the address of a cluster", fix="leave it out: the cluster has its own"
        )
    _check_answers(address)
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        with _quietly():
            del error
            gc.collect()
        raise _no_scheduler(address) from None
    with client:
        yield client


def _library() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            "--dask: Dask is not installed", fix="pip install 'visref[dask]'"
        ) from error
    return distributed


@contextmanager
def _local(distributed: Any, workers: int) -> Iterator[Any]:
    """A scheduler in this process, and workers beside it; their files are gone with them."""
    import dask

    with tempfile.TemporaryDirectory(prefix="visref-dask-", ignore_cleanup_errors=True) as folder:
        cluster = distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            # What a run may take, visref says itself (--max-memory).
            memory_limit=None,
            # Its pages and metrics are for this machine, on any free port.
            dashboard_address="127.0.0.1:0",
            local_directory=folder,
            silence_logs=logging.CRITICAL,
        )
        # A worker that ended is started again, however busy this machine is: one that is not back
        # within this time is given up by Dask.
        with cluster, dask.config.set({_GIVEN_UP: f"{_RESTART_S} s"}):
            yield cluster


def _check_answers(address: str) -> None:
    """Whether somebody listens, before a client waits for it in threads of its own."""
    from distributed.comm import get_address_host_port

    try:
        host, port = get_address_host_port(address, strict=True)
    except ValueError as error:
        raise InputError(
            f"--dask {address}: this is no address",
            fix="write tcp://HOST:PORT, as the scheduler says it, or local",
        ) from error
    except OSError as error:
        raise _no_scheduler(address) from error
    except Exception:
        # Another kind of connection: its client knows.
        return
    try:
        socket.create_connection((host, port), timeout=_CONNECT_S).close()
    except OSError as error:
        raise _no_scheduler(address) from error


def _no_scheduler(address: str) -> InputError:
    return InputError(f"--dask {address}: no scheduler answers there", fix=_START)


@contextmanager
def _quietly() -> Iterator[None]:
    """A client that never met its scheduler says so once more when it is let go."""
    before = sys.unraisablehook
    sys.unraisablehook = lambda unraisable: None
    try:
        with suppress(Exception):
            yield
    finally:
        sys.unraisablehook = before
