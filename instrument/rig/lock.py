"""One rig, one process: a lock that says who holds it, and that dies with its holder."""

from __future__ import annotations

import json
import os
import re
import socket
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from filelock import FileLock, Timeout

from drivers.errors import DeviceError
from instrument.files.whole_file import NO_LOCKS

FOLDER_VARIABLE = "HALFANGLE_LOCK_FOLDER"
"""Environment variable that names another folder for the locks than the machine's temporary one."""


class RigBusyError(DeviceError, BlockingIOError):
    """Another process holds the rig."""


@contextmanager
def hold(rig_name: str) -> Iterator[None]:
    """Hold the rig of that name within the block.

    The lock is the operating system's and ends with the process, however that ends: none is ever stale. Who holds
    it stands in a file beside it, for the message.

    Raises
    ------
    RigBusyError
        Names the process, host and user that hold it, and since when.
    DeviceError
        If the folder for the locks has none, unless HDF5_USE_FILE_LOCKING=FALSE says that no other program runs.
    """
    stem = _folder() / re.sub(r"\W+", "-", rig_name)
    holder = stem.with_suffix(".json")
    lock = FileLock(stem.with_suffix(".lock"), mode=0o666)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        who = _who(holder)
        raise RigBusyError(f"the rig {rig_name!r} is in use by {who}. Close it there, then try again") from None
    except OSError as error:
        _refuse_without_locks(error, stem.parent)
    try:
        _write(holder)
        yield
    finally:
        holder.unlink(missing_ok=True)
        lock.release()


def _refuse_without_locks(error: OSError, folder: Path) -> None:
    if error.errno not in NO_LOCKS:
        raise error
    if os.environ.get("HDF5_USE_FILE_LOCKING", "").upper() not in ("FALSE", "0"):
        what = f"{folder}: its file system has no locks, so nothing keeps two programs from using the rig at once"
        advice = f"Set the environment variable {FOLDER_VARIABLE} to a folder on a disk of this machine"
        raise DeviceError(f"{what}. {advice}, or HDF5_USE_FILE_LOCKING=FALSE if no other program uses it") from error


def _folder() -> Path:
    folder = Path(os.environ.get(FOLDER_VARIABLE) or Path(tempfile.gettempdir()) / "halfangle-locks")
    if not folder.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        # Every user of the machine shares its rigs.
        folder.chmod(0o777)
    return folder


def _write(holder: Path) -> None:
    words = {
        "pid": os.getpid(),
        "host": socket.gethostname(),
        "user": os.environ.get("USER", ""),
        "command": " ".join(Path(word).name for word in sys.argv[:2]),
        "since": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    part = holder.with_suffix(f".{os.getpid()}.part")
    part.write_text(json.dumps(words), encoding="utf-8")
    part.replace(holder)


def _who(holder: Path) -> str:
    try:
        words = json.loads(holder.read_text(encoding="utf-8"))
        return "process {pid} on {host} ({command}, {user}) since {since}".format(**words)
    except (OSError, ValueError, KeyError):
        return "another process"
