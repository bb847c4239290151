"""Files of recordings, complete or not at all."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import rerun as rr

from trackslip.errors import OutputError

APPLICATION = "trackslip"


def new_stream(title: str) -> rr.RecordingStream:
    """A stream for a new recording."""
    stream = rr.RecordingStream(APPLICATION, recording_id=uuid4())
    stream.send_recording_name(title)
    return stream


@contextlib.contextmanager
def recording(file: Path, title: str) -> Iterator[rr.RecordingStream]:
    """A stream; what it gets is the .rrd file `file` if the block succeeds. OutputError if it can't be written."""
    draft = file.with_name(f".partial-{file.name}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        draft.touch()
        with new_stream(title) as stream:
            stream.save(draft)
            yield stream
            stream.flush()
            stream.disconnect()
        draft.replace(file)
    except OSError as error:
        raise OutputError(f"{file}: can't be written ({error.strerror or error})") from error
    finally:
        draft.unlink(missing_ok=True)
