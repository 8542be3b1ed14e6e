"""Any video source as an iterator of frames, and the video writer."""
