"""Foreign formats, one file each: datasets of this library out, and foreign data in."""
