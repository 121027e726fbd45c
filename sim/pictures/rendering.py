"""Pictures of the arm in the exoskeleton: `python -m sim.pictures.rendering FILE.png [DEVICE]`."""

import sys
from math import radians
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sim.parameters.wearer import NOMINAL_WEARER
from sim.pictures.figures import new_figure
from sim.robot.device import NESM, load_device
from sim.system.build import build_system
from sim.system.start import reset_to_start
from sim.system.system import System

#: Picture size, pixels.
WIDTH, HEIGHT = 1200, 900
#: Elbow angle of the picture, rad.
ELBOW_ANGLE = radians(70.0)


class GraphicsError(RuntimeError):
    """Nothing here can render without a display."""


class Stage:
    """MuJoCo's renderer on a system, without a display; a context manager."""

    def __init__(self, system: System, width: int = WIDTH, height: int = HEIGHT) -> None:
        """Prepare a stage of `width` x `height` pixels, at most 1600 x 1200."""
        self._system = system
        self._area = mujoco.MjrRect(0, 0, width, height)
        self._camera, self._option = mujoco.MjvCamera(), mujoco.MjvOption()
        self._camera.lookat[:] = [0.13, 0.05, 0.07]
        self._camera.distance, self._camera.azimuth, self._camera.elevation = 1.0, 62.0, -18.0
        self._option.sitegroup[:] = 0
        self._gl: Any = None

    def __enter__(self) -> "Stage":
        """Open a graphics context.

        Raises:
            GraphicsError: there is neither EGL nor OSMesa.
        """
        self._gl = _graphics(self._area.width, self._area.height)
        self._gl.make_current()
        model = self._system.model
        self._scene = mujoco.MjvScene(model, maxgeom=2000)
        self._target = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._target)
        return self

    def __exit__(self, *_: object) -> None:
        self._target.free()
        self._gl.free()

    def shoot(self, data: mujoco.MjData, caption: str = "") -> np.ndarray:
        """Return an image of the positions in `data`, shape (height, width, 3), dtype uint8."""
        mujoco.mjv_updateScene(
            self._system.model,
            data,
            self._option,
            None,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        mujoco.mjr_render(self._area, self._scene, self._target)
        if caption:
            mujoco.mjr_overlay(
                mujoco.mjtFont.mjFONT_NORMAL,
                mujoco.mjtGridPos.mjGRID_BOTTOMLEFT,
                self._area,
                caption,
                "",
                self._target,
            )
        pixels = np.empty((self._area.height, self._area.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._area, self._target)
        return pixels[::-1]


def draw_system(path: Path, device: str = NESM.name) -> str:
    """Draw the nominal wearer of a device on the way; return "rendered" or "drawn".

    Where EGL or OSMesa and the extra `rendering` are installed MuJoCo renders the scene, without a
    display; elsewhere a side view is drawn from the same geometry.
    """
    system = build_system(NOMINAL_WEARER, device=load_device(device))
    data = reset_to_start(system)
    data.qpos[[system.exo_qpos[system.elbow], system.human_qpos[3]]] = ELBOW_ANGLE
    mujoco.mj_forward(system.model, data)
    try:
        with Stage(system) as stage:
            image = stage.shoot(data)
    except GraphicsError:
        _draw_side_view(system, data, path)
        return "drawn"
    import matplotlib.image

    matplotlib.image.imsave(path, image)
    return "rendered"


def _graphics(width: int, height: int) -> Any:
    """Return an OpenGL context without a display."""
    for name in ("egl", "osmesa"):
        try:
            module = __import__(f"mujoco.{name}", fromlist=["GLContext"])
            return module.GLContext(width, height)
        except (ImportError, AttributeError, RuntimeError, OSError):
            continue
    raise GraphicsError(
        "nothing here renders without a display: install the extra rehyb[rendering] and EGL or "
        "OSMesa (Debian: libegl1 or libosmesa6)"
    )


def _draw_side_view(system: System, data: mujoco.MjData, path: Path) -> None:
    """Draw every geom and muscle as seen from the right: forward to the right, up is up."""
    from matplotlib.patches import Circle, Polygon

    model = system.model
    figure = new_figure(width=8.0, height=6.0)
    axes = figure.add_subplot(1, 1, 1)
    for i in range(model.ngeom):
        centre, frame = data.geom_xpos[i], data.geom_xmat[i].reshape(3, 3)
        size, colour = model.geom_size[i], model.geom_rgba[i]
        if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_SPHERE:
            axes.add_patch(Circle(centre[[0, 2]], size[0], color=colour))
        elif model.geom_type[i] == mujoco.mjtGeom.mjGEOM_CAPSULE:
            ends = centre + np.outer([-size[1], size[1]], frame[:, 2])
            axes.plot(ends[:, 0], ends[:, 2], color=colour, linewidth=6, solid_capstyle="round")
        else:
            square = np.array([[1, 1, -1, -1], [1, -1, -1, 1]])
            corners = centre + ((frame[:, :2] * size[:2]) @ square).T
            axes.add_patch(Polygon(corners[:, [0, 2]], color=colour))
    for i in range(model.ntendon):
        first, count = data.ten_wrapadr[i], data.ten_wrapnum[i]
        points = data.wrap_xpos.reshape(-1, 3)[first : first + count]
        axes.plot(points[:, 0], points[:, 2], color=model.tendon_rgba[i], linewidth=1)
    axes.set(aspect="equal", xlabel="forward (m)", ylabel="up (m)")
    figure.savefig(path)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit("usage: python -m sim.pictures.rendering FILE.png [DEVICE]")
    print(f"{sys.argv[1]}: {draw_system(Path(sys.argv[1]), *sys.argv[2:])}")
