"""3D views that look through the cameras of views."""
