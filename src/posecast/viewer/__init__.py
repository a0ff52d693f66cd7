"""Stills, strips, GIF and MP4 without a display."""
