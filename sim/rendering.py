"""A picture of the arm in the exoskeleton: `python -m sim.rendering FILE.png`."""

import sys
from math import radians
from pathlib import Path

import mujoco
import numpy as np

from sim.control import PID
from sim.figures import new_figure
from sim.model import System, build_system, reset_to_start
from sim.wearer import NOMINAL_WEARER

#: Picture size, pixels.
WIDTH, HEIGHT = 1200, 900
#: Elbow angle of the picture, rad.
ELBOW_ANGLE = radians(70.0)


def draw_system(path: Path) -> str:
    """Draw the nominal wearer on the way; return "rendered" or "drawn".

    Where EGL and the extra `rendering` are installed MuJoCo renders the scene, without a display;
    elsewhere a side view is drawn from the same geometry.
    """
    system = build_system(NOMINAL_WEARER, PID)
    data = reset_to_start(system)
    data.qpos[[system.exo_qpos[3], system.human_qpos[3]]] = ELBOW_ANGLE
    mujoco.mj_forward(system.model, data)
    try:
        from mujoco.egl import GLContext

        context = GLContext(WIDTH, HEIGHT)
    except (ImportError, AttributeError, RuntimeError):
        _draw_side_view(system, data, path)
        return "drawn"
    import matplotlib.image

    context.make_current()
    try:
        matplotlib.image.imsave(path, _render(system, data))
    finally:
        context.free()
    return "rendered"


def _render(system: System, data: mujoco.MjData) -> np.ndarray:
    """Return an image, shape (HEIGHT, WIDTH, 3) and dtype uint8, from the current GL context."""
    camera, option = mujoco.MjvCamera(), mujoco.MjvOption()
    camera.lookat[:] = [0.13, 0.05, 0.07]
    camera.distance, camera.azimuth, camera.elevation = 1.0, 62.0, -18.0
    option.sitegroup[:] = 0
    scene = mujoco.MjvScene(system.model, maxgeom=2000)
    mujoco.mjv_updateScene(
        system.model, data, option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene
    )
    target = mujoco.MjrContext(system.model, mujoco.mjtFontScale.mjFONTSCALE_100)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, target)
    area = mujoco.MjrRect(0, 0, WIDTH, HEIGHT)
    mujoco.mjr_render(area, scene, target)
    pixels = np.empty((HEIGHT, WIDTH, 3), dtype=np.uint8)
    mujoco.mjr_readPixels(pixels, None, area, target)
    return pixels[::-1]


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
    axes.set_aspect("equal")
    axes.set_xlabel("forward (m)")
    axes.set_ylabel("up (m)")
    figure.savefig(path)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python -m sim.rendering FILE.png")
    print(f"{sys.argv[1]}: {draw_system(Path(sys.argv[1]))}")
