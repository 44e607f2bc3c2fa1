"""A session as documents of the event model, for a facility's catalogue; the frames stay where they are.

References
----------
The event model: https://blueskyproject.io/event-model
"""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterator
from datetime import datetime
from typing import Any

import numpy as np

from instrument.session import layout
from instrument.session.session import Session

Document = dict[str, Any]

_FRAMES = "frames"


def documents(session: Session) -> Iterator[tuple[str, Document]]:
    """Yield the documents of a session in their order, each with its name.

    A start; a descriptor; the frames as a stream that lies in the session file; an event for each complete pose, with
    read-backs and digests; a stop. The same session gives the same documents.

    Parameters
    ----------
    session : Session
        Open.
    """
    started = datetime.fromisoformat(session.start_time).timestamp()
    run, descriptor, stream = (_uid(session, name) for name in ("start", "descriptor", "frames"))
    complete = np.flatnonzero(session.pose_complete).tolist()
    yield "start", _start(session, run, started)
    yield "descriptor", _descriptor(session, descriptor, run, started)
    yield "stream_resource", _stream_resource(session, stream, run)
    for number, i_pose in enumerate(complete, start=1):
        yield "stream_datum", _stream_datum(stream, descriptor, number, i_pose)
        yield "event", _event(session, descriptor, started, number, i_pose)
    yield "stop", _stop(session, run, started, len(complete))


def _uid(session: Session, name: str) -> str:
    return str(uuid.uuid5(uuid.UUID(session.uuid), name))


def _start(session: Session, uid: str, started: float) -> Document:
    return {
        "uid": uid,
        "time": started,
        "plan_name": session.title,
        "sample": session.sample,
        "num_points": session.n_poses,
        "plan_sha256": session.plan_sha256,
        "serial_numbers": session.serial_numbers,
        "versions": session.versions,
        "session_digest": session.digest(),
    }


def _descriptor(session: Session, uid: str, run: str, started: float) -> Document:
    camera, n_exposures = session.camera, len(session.exposure_times)
    array = {"source": "halfangle", "dtype": "array", "shape": [n_exposures]}
    number = {"source": "halfangle", "dtype": "number", "shape": []}
    keys: dict[str, Any] = dict.fromkeys(session.axis_values, number)
    keys |= {key: {**array, "dtype_numpy": "<f8"} for key in ("exposure_readback", "saturated_fraction", "monitor")}
    keys["pose"] = {**number, "dtype": "integer"}
    keys["pose_digest"] = {**number, "dtype": "string"}
    keys[_FRAMES] = {
        **array,
        "shape": [n_exposures, *camera.frame_shape],
        "dtype_numpy": f"<{camera.dtype}",
        "external": "STREAM:",
    }
    return {
        "uid": uid,
        "run_start": run,
        "time": started,
        "name": "primary",
        "data_keys": keys,
        "object_keys": {"session": list(keys)},
        "configuration": {},
        "hints": {},
    }


def _stream_resource(session: Session, uid: str, run: str) -> Document:
    return {
        "uid": uid,
        "run_start": run,
        "data_key": _FRAMES,
        "mimetype": "application/x-hdf5",
        "uri": session.path.resolve().as_uri(),
        "parameters": {"dataset": layout.IMAGES.path, "chunk_shape": [1, 1, *session.camera.frame_shape]},
    }


def _stream_datum(stream: str, descriptor: str, number: int, i_pose: int) -> Document:
    return {
        "uid": f"{stream}/{i_pose}",
        "stream_resource": stream,
        "descriptor": descriptor,
        # Events are counted from one; where a pose lies in the file is what its index says.
        "seq_nums": {"start": number, "stop": number + 1},
        "indices": {"start": i_pose, "stop": i_pose + 1},
    }


def _event(session: Session, descriptor: str, started: float, number: int, i_pose: int) -> Document:
    when = session.timestamps[i_pose]
    time = started + (float(np.nanmax(when)) if np.isfinite(when).any() else 0.0)
    data: dict[str, Any] = {axis: float(values[i_pose]) for axis, values in session.axis_values.items()}
    data["exposure_readback"] = session.exposure_readback[i_pose].tolist()
    data["saturated_fraction"] = session.saturated_fraction[i_pose].tolist()
    data["monitor"] = session.monitor[i_pose].tolist()
    data["pose"], data["pose_digest"] = i_pose, session.pose_digests[i_pose]
    return {
        "uid": str(uuid.uuid5(uuid.UUID(descriptor), str(i_pose))),
        "descriptor": descriptor,
        "seq_num": number,
        "time": time,
        "data": data,
        "timestamps": dict.fromkeys(data, time),
        "filled": {},
    }


def _stop(session: Session, run: str, started: float, n_events: int) -> Document:
    ended = datetime.fromisoformat(session.end_time).timestamp() if session.end_time else started
    return {
        "uid": _uid(session, "stop"),
        "run_start": run,
        "time": ended,
        "exit_status": "success" if session.status is layout.Status.COMPLETE else "abort",
        "num_events": {"primary": n_events},
    }


def as_line(name: str, document: Document) -> str:
    """Return a document with its name as a line of JSON; what is not finite becomes null."""
    return json.dumps([name, _finite(document)])


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
