"""How the camera moved from one frame to the next, seen in the pictures themselves."""

from lookonce.camera.motion import CameraMotion
from lookonce.camera.pictures import luma_of_canvas

__all__ = ["CameraMotion", "luma_of_canvas"]
