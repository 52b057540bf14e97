"""A run in the viewer of rerun.io (extra `rerun`): cameras, recorded and rendered frames, displacement and Gaussians over time."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.engine.errors import DegenseError
from degense.engine.files import replacing
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.scene import Scene

#: Gaussians that are fainter are not sent.
FAINT = 1 / 255


def send_run(scene: Scene, out: Path | None = None) -> Steps[str]:
    """Open rerun's viewer and send it the run frame after frame, or write it to `out` (.rrd). DegenseError without rerun."""
    try:
        import rerun as rr
    except ImportError as error:
        raise DegenseError("The viewer rerun is not installed; install it with: pip install 'degense[rerun]'.") from error
    if out is not None and out.suffix.lower() != ".rrd":
        raise DegenseError(f"{out} must end in .rrd.")
    recording = rr.RecordingStream("degense")
    with nullcontext() if out is None else replacing(out) as temporary:
        if temporary is None:
            recording.spawn()
        else:
            recording.save(temporary)
        recording.log("scene", rr.ViewCoordinates.RDF, static=True)
        for frame in range(scene.frames):
            yield frame / scene.frames, f"frame {frame}"
            recording.set_time("frame", sequence=frame)
            recording.set_time("time", duration=frame / scene.fps)
            _log_frame(rr, recording, scene, frame)
        recording.flush()
        recording.disconnect()
    return f"{out or 'rerun'}: {scene.frames} frames"


def _log_frame(rr: Any, recording: Any, scene: Scene, frame: int) -> None:
    camera, splats = scene.camera(frame), scene.splats(frame)
    pose = np.linalg.inv(camera.viewmat)
    recording.log("scene/camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
    size = [camera.width, camera.height]
    recording.log("scene/camera/image", rr.Pinhole(image_from_camera=camera.intrinsics, resolution=size, camera_xyz=rr.ViewCoordinates.RDF))
    recording.log("scene/camera/image", rr.Image(scene.render_rgb(frame)).compress())
    if (observed := scene.observed(frame)) is not None:
        recording.log("recorded", rr.Image(observed).compress())
    recording.log("displacement", rr.DepthImage(np.nan_to_num(scene.render(frame, what=("displacement",))["displacement"])))
    seen = (splats.opacities >= FAINT).cpu().numpy()
    means, quats, scales, opacities, colors = (
        tensor.cpu().numpy()[seen] for tensor in (splats.means, splats.quats, splats.scales, splats.opacities, splats.colors)
    )
    rgba = (np.c_[colors.clip(0, 1), opacities] * 255 + 0.5).astype(np.uint8)
    unit = quats[:, [1, 2, 3, 0]] / np.linalg.norm(quats, axis=1, keepdims=True)
    recording.log("scene/gaussians", rr.GaussianSplats3D(means, scales=scales, quaternions=unit, colors=rgba))
