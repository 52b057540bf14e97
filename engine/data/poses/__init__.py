"""Where the camera was: poses of clips that bring none, from the motion of what they show."""

from degense.engine.data.poses.estimate import PoseEstimate, estimate_poses, find_cameras, with_cameras

__all__ = ["PoseEstimate", "estimate_poses", "find_cameras", "with_cameras"]
