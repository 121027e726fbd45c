"""A film of one assessment, from donning to its end or to where it failed."""

from collections.abc import Iterator
from math import degrees
from pathlib import Path

import mujoco
import numpy as np

from sim.pictures.rendering import Stage
from sim.system.system import System

#: Frames of a film per simulated second, and its size, pixels.
RATE = 25
WIDTH, HEIGHT = 800, 600
#: Seconds for which the last frame stands.
LAST = 1.5
FORMATS = (".mp4", ".gif")


class Film:
    """What was seen of one assessment: pass `watch` to `assess`, then `write`."""

    def __init__(self, rate: int = RATE) -> None:
        """Begin a film of `rate` frames per simulated second."""
        self.rate = rate
        self._system: System | None = None
        self._times: list[float] = []
        self._positions: list[np.ndarray] = []

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._times)

    def watch(self, system: System, data: mujoco.MjData) -> None:
        """Take a frame if it is time for one."""
        self._system = system
        begun = self._times[0] if self._times else data.time
        if (data.time - begun) * self.rate >= len(self) - 1e-6 and np.isfinite(data.qpos).all():
            self._times.append(float(data.time))
            self._positions.append(data.qpos.copy())

    def write(self, path: Path, title: str) -> Path:
        """Render what was seen and write it to `path`, .mp4 or .gif; return `path`.

        Args:
            path: the file; its name says the format.
            title: a line under every frame.

        Raises:
            ValueError: the format is unknown, nothing was seen, or the extra for it is missing.
            GraphicsError: nothing here renders without a display.
            OSError: the file cannot be written.
        """
        check_format(path)
        if self._system is None or not self._times:
            raise ValueError("there is nothing to film: the assessment ended before its first step")
        if path.suffix == ".mp4":
            _write_mp4(path, self._frames(title), self.rate)
        else:
            _write_gif(path, self._frames(title), self.rate)
        return path

    def _frames(self, title: str) -> Iterator[np.ndarray]:
        system = self._system
        assert system is not None
        data = mujoco.MjData(system.model)
        joint = system.target.joint
        # A software renderer takes three times as long to smooth edges.
        system.model.vis.quality.offsamples = 0
        with Stage(system, WIDTH, HEIGHT) as stage:
            for time, position in zip(self._times, self._positions, strict=True):
                data.qpos[:] = position
                mujoco.mj_fwdPosition(system.model, data)
                exo = degrees(position[system.exo_qpos[system.moved]])
                human = degrees(position[system.human_qpos[joint]])
                image = stage.shoot(
                    data, f"{title}\n{time:4.1f} s  robot {exo:4.0f}  human {human:4.0f} degrees"
                )
                yield image
            for _ in range(round(LAST * self.rate)):
                yield image


def check_format(path: Path) -> None:
    """Raise ValueError unless a film can be written to a file of that name here."""
    if path.suffix not in FORMATS:
        raise ValueError(f"{path} is no film: its name must end in {' or '.join(FORMATS)}")
    try:
        if path.suffix == ".mp4":
            import av  # noqa: F401
        else:
            import PIL.Image  # noqa: F401
    except ImportError:
        extra, other = ("video", " or write a .gif") if path.suffix == ".mp4" else ("figures", "")
        raise ValueError(
            f"{path.suffix} needs the extra rehyb[{extra}]: install it{other}"
        ) from None


def _write_mp4(path: Path, frames: Iterator[np.ndarray], rate: int) -> None:
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for image in frames:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def _write_gif(path: Path, frames: Iterator[np.ndarray], rate: int) -> None:
    """Write every other frame, at half the size: a GIF is large."""
    from PIL import Image

    images = [
        Image.fromarray(frame).resize((WIDTH // 2, HEIGHT // 2)).quantize(64)
        for number, frame in enumerate(frames)
        if number % 2 == 0
    ]
    images[0].save(path, save_all=True, append_images=images[1:], duration=2000 // rate, loop=0)
