"""Videos, encoded by PyAV, which is only needed for them."""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from trackslip.errors import OutputError, TrackslipError, first_line

FRAME_RATE = 25
"""Pictures per second of a video [Hz]."""


def require_video() -> None:
    """Raise TrackslipError if PyAV isn't installed."""
    if importlib.util.find_spec("av") is None:
        raise TrackslipError('a video needs PyAV: pip install -e ".[video]"; --pictures N needs nothing else')


@contextlib.contextmanager
def video(file: Path, width: int, height: int) -> Iterator[Callable[[np.ndarray], None]]:
    """Yields what adds a picture (height, width, 3) uint8 to an .mp4 file; width and height are even.

    The file is complete or not written at all. Raises OutputError if it can't be written.
    """
    import av

    draft = file.with_name(f".partial-{file.name}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(draft), "w", format="mp4") as container:
            stream = container.add_stream("libx264", rate=FRAME_RATE, options={"crf": "22", "preset": "veryfast"})
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.time_base = Fraction(1, FRAME_RATE)

            def add(picture: np.ndarray) -> None:
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))

            yield add
            container.mux(stream.encode())
        draft.replace(file)
    except av.FFmpegError as error:
        raise OutputError(f"{file}: can't be written ({first_line(error)})") from error
    except OSError as error:
        raise OutputError(f"{file}: can't be written ({error.strerror or error})") from error
    finally:
        draft.unlink(missing_ok=True)
